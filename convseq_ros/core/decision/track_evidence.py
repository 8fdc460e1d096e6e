# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How strongly the last frames together speak for one place, in units that need no site's threshold.

One frame alone can look like another place by chance; at a true place the best diagonal stays the
best, frame after frame. So the margins over other places, less what chance gives, are summed along
the diagonal and divided by how much other places scatter on this drive; the fewer of them there
are, the less it means to beat them. And a track ends where its newest frame ends it: where a road
forks, nine frames of ten still show the known one.

What chance gives, the fewest rivals, the shortest drive, the prior of the scatter, the doubt of
other slopes and the least evidence were chosen on the drawn drives of scripts/fit_acceptance.py
and on real images made dark, neither of which is reported.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
import math

from convseq_ros.core.sequence.diagonals import diagonal, Row
import numpy as np
import numpy.typing as npt

WINDOW = 8
MEMORY = 30
SAME_TRACK = 2
_OWN_PEAK = 5
_NEIGHBOURHOOD = 10
_FEWEST_RIVALS = 8
_CHANCE = 6.0
_RIM = 2
_PRIOR_FRAMES = 5
_SMALLEST_SCATTER = 0.001
_USUAL_SCATTER = 0.006
_PRIOR_WINDOWS = 2
_SHORTEST_DRIVE = 20
_DOUBT_OF_OTHER_SLOPES = 1.5

Values = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


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
        By how much that diagonal beats those of other places, beyond what chance gives; 0 at the
        rim of the map, where the peak may lie beyond, and among too few rivals.
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
    The scores of a row are taken relative to what each reference usually scores on this drive, and
    to the row's mean, so that a pair that was not scored (shortlist) counts as average. Usually is
    when the reference is not near the place to which at least half of the last frames lead. A
    window of 8 frames, whatever the sequence length k, keeps the scatter comparable.

    """

    def __init__(self) -> None:
        self._sums: Values = np.zeros(0)
        self._counts: Values = np.zeros(0)
        self._total = 0.0
        self._pairs = 0
        self._variance = 0.0
        self._windows = 0
        self._start: int | None = None
        self._sights: deque[Sight] = deque()
        self._ends: Indices = np.zeros(0, np.int64)
        self._now: Values = np.zeros(0)

    @property
    def scatter(self) -> float | None:
        """How much other places scatter on this drive; None before that is known."""
        if not self._windows:
            return None
        variance = self._variance + _PRIOR_WINDOWS * _USUAL_SCATTER**2
        windows = self._windows + _PRIOR_WINDOWS
        return float(np.sqrt(variance / windows)) + _SMALLEST_SCATTER

    def follow(
        self, frame: int, rows: Sequence[Row | None], ends: Indices, slope: float = 1.0
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
            are so many. An older one may end sooner, where the map has grown since.
        ends : ndarray of int64, shape (n,)
            The references, ascending, that the newest frame may show.
        slope : float
            References that pass while one frame does.

        """
        newest = rows[0]
        if newest is None:
            raise ValueError('the newest frame must be informative')
        while self._sights and self._sights[0].frame <= frame - MEMORY:
            self._sights.popleft()
        self._make_room(len(newest))
        window = [
            None if row is None else self._above(row, ends - step)
            for step, row in zip(
                diagonal(min(len(rows), WINDOW), slope), rows[:WINDOW], strict=True
            )
        ]
        self._ends, self._now = ends, np.array(window[0])
        heights = _means(window, len(ends))
        known = np.flatnonzero(np.isfinite(heights + self._now))
        if not len(known):
            self._learn(newest, ends)
            return None
        top = known[heights[known].argmax()]
        best = int(ends[top])
        elsewhere = _beyond(heights, ends, best, _NEIGHBOURHOOD)
        margin = 0.0
        if len(elsewhere) >= _FEWEST_RIVALS:
            if len(window) == WINDOW:
                self._variance += float(elsewhere.var())
                self._windows += 1
            if best < len(newest) - _RIM:
                rivals = _beyond(heights, ends, best, _OWN_PEAK)
                chance = _CHANCE * (self.scatter or 0.0) / math.sqrt(len(elsewhere))
                margin = max(0.0, float(heights[top] - rivals.max()) - chance)
        sight = Sight(frame, best, margin, len(elsewhere))
        self._sights.append(sight)
        lately = [one for one in self._along(frame, best, slope) if one.frame > frame - WINDOW]
        is_tracked = 2 * len(lately) >= WINDOW
        self._learn(newest, ends[abs(ends - best) > _NEIGHBOURHOOD] if is_tracked else ends)
        return sight

    def evidence(self, frame: int, reference: int, slope: float = 1.0) -> float | None:
        """
        Return how strongly the last 30 frames, and the newest, say that it shows a reference.

        Returns
        -------
        float or None
            Mean margin of those frames whose own best diagonal is this one, in units of the
            scatter; frames that are missing or point elsewhere count as 0. Early in a drive the
            mean is over the frames since it was first asked for and there were rivals, 20 at
            least. No more, however, than the standard deviations by which the newest frame alone
            speaks for the place; and a third less at another slope than 1, of which there are
            many. 0 for the last two references if the query drives more slowly than the map: so it
            looks to a drive that has left the map and still sees its end. None while the scatter
            is unknown.

        """
        if self._start is None and self._sights and self._sights[-1].enough_rivals:
            self._start = frame
        if self.scatter is None:
            return None
        if slope < 1.0 and reference >= len(self._sums) - _RIM:
            return 0.0
        started = frame if self._start is None else self._start
        margins = [sight.margin for sight in self._along(frame, reference, slope)]
        frames = min(max(frame - started + 1, _SHORTEST_DRIVE), MEMORY)
        along = sum(margins) / (frames * self.scatter)
        along = min(along, self._newest_alone(reference))
        return along if slope == 1.0 else along / _DOUBT_OF_OTHER_SLOPES

    def _along(self, frame: int, reference: int, slope: float) -> list[Sight]:
        """Return the sights on the diagonal that ends at a reference."""
        return [
            sight
            for sight in self._sights
            if abs(reference - sight.reference - slope * (frame - sight.frame)) <= SAME_TRACK
        ]

    def _newest_alone(self, reference: int) -> float:
        """Return by how many standard deviations the newest frame speaks for a reference."""
        elsewhere = _beyond(self._now, self._ends, reference, _NEIGHBOURHOOD)
        near = self._now[abs(self._ends - reference) <= SAME_TRACK]
        if len(elsewhere) < _FEWEST_RIVALS or not np.isfinite(near).any():
            return np.inf
        above = float(np.nanmax(near) - elsewhere.mean())
        return above / (float(elsewhere.std()) + _SMALLEST_SCATTER)

    def _make_room(self, count: int) -> None:
        more = max(0, count - len(self._sums))
        if more:
            self._sums = np.append(self._sums, np.zeros(more))
            self._counts = np.append(self._counts, np.zeros(more))

    def _above(self, row: Row, indices: Indices) -> Values:
        """Return scores relative to what their references usually score, and to their mean."""
        met = (indices >= 0) & (indices < len(row))
        there = indices[met]
        overall = self._total / max(self._pairs, 1)
        usual = (self._sums[there] + _PRIOR_FRAMES * overall) / (
            self._counts[there] + _PRIOR_FRAMES
        )
        above = np.full(len(indices), np.nan)
        above[met] = row[there] - usual
        known = np.isfinite(above)
        return above - above[known].mean() if known.any() else above

    def _learn(self, row: Row, ends: Indices) -> None:
        known = ends[np.isfinite(row[ends])]
        self._sums[known] += row[known]
        self._counts[known] += 1
        self._total += float(row[known].sum(dtype=np.float64))
        self._pairs += len(known)


def _means(window: Sequence[Values | None], count: int) -> Values:
    """
    Return an eighth of the sum over each diagonal.

    A pair that was not scored counts as 0; where half of them are missing, there is NaN.
    """
    total, pairs = np.zeros(count), np.zeros(count)
    for values in window:
        if values is not None:
            known = np.isfinite(values)
            total += np.where(known, values, 0.0)
            pairs += known
    return np.where(2 * pairs >= len(window), total / WINDOW, np.nan)


def _beyond(heights: Values, ends: Indices, best: int, distance: int) -> Values:
    """Return what is known further than a distance from the best."""
    known: Values = heights[(abs(ends - best) > distance) & np.isfinite(heights)]
    return known
