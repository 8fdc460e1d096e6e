# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The best few places among all scores."""

from collections.abc import Sequence

from convseq_ros.config import AcceptanceConfig
from convseq_ros.core.map.place import Place
from convseq_ros.core.sequence.diagonals import diagonal
from convseq_ros.core.types import Candidate, Reason
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

    `scores` are those of the sequences that end at `ends`, (n,), -inf where there is none.
    """
    remaining = scores.copy()
    found: list[Candidate] = []
    while len(found) < config.num_candidates and np.isfinite(remaining).any():
        top = int(remaining.argmax())
        index = int(ends[top])
        found.append(Candidate(index, places[index].stamp_ns, float(scores[top])))
        remaining[abs(ends - index) <= config.rival_distance] = -np.inf
    return tuple(found)


def why_none(usable: int, length: int, velocity: float) -> Reason:
    """Return why no sequence of so many frames has a score, with so many usable references."""
    short = usable <= diagonal(length, velocity)[-1]
    return Reason.MAP_TOO_SHORT if short else Reason.WARMING_UP
