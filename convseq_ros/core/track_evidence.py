# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How strongly the last frames together speak for one place, in units that need no site's threshold.

One frame alone can look like another place by chance; at a true place the best diagonal stays the
best, frame after frame. So the margins over other places are summed along the diagonal and divided
by how much other places scatter on this drive. And a track ends where its newest frame ends it:
where a road forks, nine frames of ten still show the known one.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from convseq_ros.core.sequence import diagonal, Row
import numpy as np
import numpy.typing as npt

WINDOW = 10
MEMORY = 25
SAME_TRACK = 2
_OWN_PEAK = 5
_NEIGHBOURHOOD = 10
_FEWEST_RIVALS = 5
_RIM = 2
_PRIOR_FRAMES = 5
_SMALLEST_SCATTER = 0.002

Values = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sight:
    """
    What one frame says.

    Parameters
    ----------
    frame : int
        Its number.
    reference : int
        The reference at which the best diagonal ends.
    margin : float
        By how much that diagonal beats those of other places; 0 at the rim of the map, where the
        peak may lie beyond, and among too few rivals.
    rivals : int
        Diagonals further than 10 references from the best.

    """

    frame: int
    reference: int
    margin: float
    rivals: int

    @property
    def enough_rivals(self) -> bool:
        """Whether there were other places to compare with."""
        return self.rivals >= _FEWEST_RIVALS


class TrackEvidence:
    """
    Follows the best diagonal through a drive; causal.

    Notes
    -----
    The scores of a row are taken relative to what each reference usually scores on this drive and
    to the row's mean, so that a pair that was not scored (shortlist) counts as average. A window
    of 10 frames, whatever the sequence length k, keeps the scatter comparable from frame to frame.

    """

    def __init__(self) -> None:
        self._sums: Values = np.zeros(0)
        self._counts: Values = np.zeros(0)
        self._variance = 0.0
        self._windows = 0
        self._sights: deque[Sight] = deque()
        self._now: Values = np.zeros(0)

    @property
    def newest(self) -> Sight | None:
        """What the newest frame says; None if it says nothing."""
        return self._sights[-1] if self._sights else None

    @property
    def scatter(self) -> float | None:
        """How much other places scatter on this drive; None before that is known."""
        if not self._windows:
            return None
        return float(np.sqrt(self._variance / self._windows)) + _SMALLEST_SCATTER

    def follow(
        self, frame: int, rows: Sequence[Row | None], slope: float = 1.0
    ) -> Sight | None:
        """
        Take note of a frame and return what it says.

        Parameters
        ----------
        frame : int
            Its number; frames that are passed over leave a gap.
        rows : sequence of ndarrays of float32, or None
            Pair scores of it and the frames before it, newest first, NaN where there is none;
            None for an uninformative frame, which the newest is not. At least 10 as soon as there
            are so many. The newest has an entry for every reference that may be matched.
        slope : float
            References that pass while one frame does.

        """
        newest = rows[0]
        if newest is None:
            raise ValueError('the newest frame must be informative')
        while self._sights and self._sights[0].frame <= frame - MEMORY:
            self._sights.popleft()
        self._make_room(len(newest))
        usual = self._usual()
        self._now = _above(newest, usual)
        window: list[Values | None] = [self._now]
        window += [None if row is None else _above(row, usual) for row in rows[1:WINDOW]]
        heights = _diagonals(window, len(newest), slope)
        self._learn(newest)
        ends = np.where(np.isfinite(newest + heights), heights, -np.inf)
        if not np.isfinite(ends).any():
            return None
        best = int(ends.argmax())
        elsewhere = _beyond(heights, best, _NEIGHBOURHOOD)
        margin = 0.0
        if len(elsewhere) >= _FEWEST_RIVALS:
            if len(window) == WINDOW:
                self._variance += float(elsewhere.var())
                self._windows += 1
            if best < len(newest) - _RIM:
                margin = float(heights[best] - _beyond(heights, best, _OWN_PEAK).max())
        sight = Sight(frame, best, margin, len(elsewhere))
        self._sights.append(sight)
        return sight

    def evidence(self, frame: int, reference: int, slope: float = 1.0) -> float | None:
        """
        Return how strongly the last 25 frames, and the newest, say that it shows a reference.

        Returns
        -------
        float or None
            Mean margin of those frames whose own best diagonal is this one, in units of the
            scatter; frames that are missing or point elsewhere count as 0. No more, however, than
            the standard deviations by which the newest frame alone speaks for the place. None
            while the scatter is unknown.

        """
        if self.scatter is None:
            return None
        margins = [
            sight.margin
            for sight in self._sights
            if abs(reference - sight.reference - slope * (frame - sight.frame)) <= SAME_TRACK
        ]
        along = sum(margins) / (MEMORY * self.scatter)
        return min(along, self._newest_alone(reference))

    def _newest_alone(self, reference: int) -> float:
        """Return by how many standard deviations the newest frame speaks for a reference."""
        elsewhere = _beyond(self._now, reference, _NEIGHBOURHOOD)
        near = self._now[max(0, reference - SAME_TRACK) : reference + SAME_TRACK + 1]
        if len(elsewhere) < _FEWEST_RIVALS or not np.isfinite(near).any():
            return np.inf
        above = float(np.nanmax(near) - elsewhere.mean())
        return above / (float(elsewhere.std()) + _SMALLEST_SCATTER)

    def _make_room(self, count: int) -> None:
        more = max(0, count - len(self._sums))
        self._sums = np.append(self._sums, np.zeros(more))
        self._counts = np.append(self._counts, np.zeros(more))

    def _usual(self) -> Values:
        overall = self._sums.sum() / max(self._counts.sum(), 1.0)
        usual: Values = (self._sums + _PRIOR_FRAMES * overall) / (self._counts + _PRIOR_FRAMES)
        return usual

    def _learn(self, row: Row) -> None:
        known = np.isfinite(row)
        self._sums[: len(row)] += np.where(known, row, 0.0)
        self._counts[: len(row)] += known


def _above(row: Row, usual: Values) -> Values:
    """Return a row relative to what its references usually score, and to its mean."""
    above: Values = row - usual[: len(row)]
    known = np.isfinite(above)
    return above - above[known].mean() if known.any() else above


def _diagonals(window: Sequence[Values | None], count: int, slope: float) -> Values:
    """
    Return a tenth of the sum over the diagonal that ends at each reference.

    A pair that was not scored counts as 0; where half of them are missing, there is NaN.
    """
    total, pairs = np.zeros(count), np.zeros(count)
    for step, row in zip(diagonal(len(window), slope), window, strict=True):
        if row is None:
            continue
        met = row[: max(0, count - step)]
        total[step : step + len(met)] += np.where(np.isfinite(met), met, 0.0)
        pairs[step : step + len(met)] += np.isfinite(met)
    return np.where(2 * pairs >= len(window), total / WINDOW, np.nan)


def _beyond(heights: Values, best: int, distance: int) -> Values:
    """Return what is known further than a distance from the best."""
    outside = heights.copy()
    outside[max(0, best - distance) : best + distance + 1] = np.nan
    known: Values = outside[np.isfinite(outside)]
    return known
