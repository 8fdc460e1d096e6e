# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The best few places among all scores."""

from collections.abc import Sequence

from convseq_ros.config import AcceptanceConfig
from convseq_ros.core.reference_map import Place
from convseq_ros.core.types import Candidate
import numpy as np
import numpy.typing as npt


def best_candidates(
    scores: npt.NDArray[np.float64], places: Sequence[Place], config: AcceptanceConfig
) -> tuple[Candidate, ...]:
    """
    Return the best places, best first, no two of them neighbours.

    Parameters
    ----------
    scores : ndarray of float64, shape (R,)
        Sequence scores; -inf where there is none.
    places : sequence of Place
        The R references.
    config : AcceptanceConfig
        How many, and how far apart.

    """
    remaining = scores.copy()
    found: list[Candidate] = []
    while len(found) < config.num_candidates and np.isfinite(remaining).any():
        index = int(remaining.argmax())
        found.append(Candidate(index, places[index].stamp_ns, float(scores[index])))
        near = max(0, index - config.rival_distance)
        remaining[near : index + config.rival_distance + 1] = -np.inf
    return tuple(found)
