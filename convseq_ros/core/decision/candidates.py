# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The best few places among all scores."""

from collections.abc import Sequence

from convseq_ros.config import AcceptanceConfig
from convseq_ros.core.map.reference_map import Place
from convseq_ros.core.types import Candidate
import numpy as np
import numpy.typing as npt


def best_candidates(
    ends: npt.NDArray[np.int64],
    scores: npt.NDArray[np.float64],
    places: Sequence[Place],
    config: AcceptanceConfig,
) -> tuple[Candidate, ...]:
    """
    Return the best places, best first, no two of them neighbours.

    Parameters
    ----------
    ends : ndarray of int64, shape (n,)
        The references that were scored, ascending.
    scores : ndarray of float64, shape (n,)
        Their sequence scores; -inf where there is none.
    places : sequence of Place
        All references.
    config : AcceptanceConfig
        How many, and how far apart.

    """
    remaining = scores.copy()
    found: list[Candidate] = []
    while len(found) < config.num_candidates and np.isfinite(remaining).any():
        top = int(remaining.argmax())
        index = int(ends[top])
        found.append(Candidate(index, places[index].stamp_ns, float(scores[top])))
        remaining[abs(ends - index) <= config.rival_distance] = -np.inf
    return tuple(found)
