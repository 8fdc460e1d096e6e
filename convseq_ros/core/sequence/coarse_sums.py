# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sums of coarse scores along diagonals: what the shortlist asks for, of a map or of many shards.

A shard knows its sums alone; what they have in common, the mean of a row and the spread of all
sums, is added up from those of all shards.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
import math
from typing import Any

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence.diagonals import diagonal, ONE_SESSION, Values
from convseq_ros.core.types import Indices
import numpy as np

GROUP = 64  # scores of which only the best is looked at first


@dataclass(frozen=True, slots=True)
class Spread:
    """Of all sums that are finite; may be added to that of other ones."""

    count: int = 0
    total: float = 0.0
    squares: float = 0.0
    lowest: float = math.inf
    highest: float = -math.inf

    @property
    def deviation(self) -> float:
        """Standard deviation; of at least one sum."""
        mean = self.total / self.count
        return math.sqrt(max(0.0, self.squares / self.count - mean**2))

    @property
    def range(self) -> float:
        """From the lowest to the highest; of at least one sum."""
        return self.highest - self.lowest

    def __add__(self, other: 'Spread') -> 'Spread':
        return Spread(
            self.count + other.count,
            self.total + other.total,
            self.squares + other.squares,
            min(self.lowest, other.lowest),
            max(self.highest, other.highest),
        )


@dataclass(frozen=True, eq=False, slots=True)
class Asked:
    """Which sums are wanted: of some rows at a velocity, so many best and those of known ends."""

    rows: Sequence[Any]  # newest first; of one map `Rows`, of a fleet what stands for them
    velocity: float
    most: int
    known: Indices  # ascending


@dataclass(frozen=True, eq=False, slots=True)
class Sums:
    """Sums (n,) by their ends, ascending; -inf where a diagonal has none."""

    ends: Indices
    scores: Values
    spread: Spread  # of all, also of those that are not told; of none if no end is known

    def at(self, ends: Indices) -> Indices:
        """Return where some ends lie among those told."""
        return np.searchsorted(self.ends, ends)


def enough(length: int, rival_distance: int) -> int:
    """Return how many best sums tell a shortlist: each that is listed hides those near it."""
    return length * (2 * rival_distance + 2)


def all_sums(
    asked: Asked, bounds: SessionBounds = ONE_SESSION, means: Sequence[Any] | None = None
) -> Sums:
    """Return all sums of a map; `means` of its rows, if other maps count as well."""
    steps = np.array(diagonal(len(asked.rows), asked.velocity))
    kernels = kernels_of(__package__)
    scores = kernels.partial_scores(asked.rows, steps, bounds.starts, means)
    spread = _spread(scores[np.isfinite(scores)]) if len(asked.known) else Spread()
    return Sums(_every(len(scores)), scores, spread)


def _spread(scores: Values) -> Spread:
    if not scores.size:
        return Spread()
    # No copy in float64: its memory is as dear as the sum. Nor by BLAS, whose threads wait.
    total = float(scores.sum(dtype=np.float64))
    squares = float(np.einsum('i,i', scores, scores, dtype=np.float64))
    return Spread(scores.size, total, squares, float(scores.min()), float(scores.max()))


@lru_cache(1)
def _every(count: int) -> Indices:
    every = np.arange(count)
    every.flags.writeable = False
    return every


def best_sums(asked: Asked, found: Sums) -> Sums:
    """Return those of all sums that are asked for, and perhaps a few more."""
    best, wanted = top(found.scores, asked.most), np.zeros(len(found.scores), np.bool_)
    wanted[best], wanted[asked.known] = np.isfinite(found.scores[best]), True
    best = np.flatnonzero(wanted)
    return Sums(best, found.scores[best], found.spread)


def top(scores: Values, most: int) -> Indices:
    """Return where the best so many scores are, ascending, and some others."""
    groups = len(scores) // GROUP
    if groups <= most:
        return np.arange(len(scores))
    # So many groups have a score that is no worse than this one.
    best = scores[: groups * GROUP].reshape(GROUP, groups).max(axis=0)
    bound = np.partition(best, groups - most)[groups - most]
    return np.flatnonzero(scores >= bound)
