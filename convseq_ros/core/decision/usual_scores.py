# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What each reference usually scores on a drive."""

from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence.diagonals import diagonal, ONE_SESSION, pairs_along, Rows, Values
from convseq_ros.core.types import Indices, Row
import numpy as np

_PRIOR_FRAMES = 5  # that the mean of all counts for; fitted with the constants of the track


class UsualScores:
    """What references usually score on a drive: means over frames that hardly show them."""

    def __init__(self, bounds: SessionBounds = ONE_SESSION) -> None:
        self._bounds = bounds
        self._sums, self._counts = np.zeros(0), np.zeros(0)
        self._total, self._pairs = 0.0, 0

    def __len__(self) -> int:
        return len(self._sums)

    def above(self, rows: Rows, ends: Indices, velocity: float) -> Values:
        """Return pair scores (k, n) above what their references usually score, and their mean."""
        if rows[0] is not None and len(rows[0]) > len(self):
            more = np.zeros(len(rows[0]) - len(self))
            self._sums, self._counts = np.append(self._sums, more), np.append(self._counts, more)
        steps = diagonal(len(rows), velocity)
        prior = _PRIOR_FRAMES * self._total / max(self._pairs, 1)
        pairs = pairs_along(rows, ends, steps, np.float64, self._bounds)
        for values, step in zip(pairs, steps, strict=True):
            known = np.flatnonzero(np.isfinite(values))
            met = ends[known] - step
            usual = (self._sums[met] + prior) / (self._counts[met] + _PRIOR_FRAMES)
            above = values[known] - usual
            values[known] = above - above.mean() if len(above) else above
        return pairs

    def learn(self, row: Row, ends: Indices) -> None:
        """Take in the scores of some references in a row (R,), NaN where there is none."""
        known = ends[np.isfinite(row[ends])]
        self._sums[known] += row[known]
        self._counts[known] += 1
        self._total += float(row[known].sum(dtype=np.float64))
        self._pairs += len(known)
