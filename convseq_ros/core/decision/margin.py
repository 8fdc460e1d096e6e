# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the best candidate is a match, by its lead over the best rival."""

from convseq_ros.config import AcceptanceConfig
from convseq_ros.core.decision.neighbourhood import Neighbourhood
from convseq_ros.core.types import Candidates, Reason
import numpy as np


def decide_by_margin(
    candidates: Candidates, config: AcceptanceConfig, places: Neighbourhood | None = None
) -> Reason:
    """Decide by the lead over the best rival: scores of unrelated places lie near true ones."""
    places, distance = places or Neighbourhood(), config.rival_distance
    ends = np.array([one.reference_index for one in candidates])
    scores = np.array([one.score for one in candidates])
    best = int(ends[0])
    places.follow(best, ends, scores, distance, distance)
    rivals = scores[~places.near(ends, best, distance)]
    if not len(rivals):
        return Reason.TOO_FEW_RIVALS
    return Reason.ACCEPTED if scores[0] - rivals[0] >= config.min_margin else Reason.AMBIGUOUS
