# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the best candidate is a match, and why or why not."""

from collections.abc import Sequence

from convseq_ros.config import AcceptanceConfig
from convseq_ros.core.types import Candidate, Reason


def decide(candidates: Sequence[Candidate], config: AcceptanceConfig) -> Reason:
    """
    Decide by the margin between the best candidate and its best rival.

    Parameters
    ----------
    candidates : sequence of Candidate
        At least one, best first, neighbours left out.
    config : AcceptanceConfig
        The least margin.

    Notes
    -----
    The paper always answers with the best candidate. Scores of unrelated places lie too near those
    of true ones for an absolute threshold, so the margin decides.

    """
    if len(candidates) < 2:
        return Reason.TOO_FEW_RIVALS
    margin = candidates[0].score - candidates[1].score
    return Reason.ACCEPTED if margin >= config.min_margin else Reason.AMBIGUOUS
