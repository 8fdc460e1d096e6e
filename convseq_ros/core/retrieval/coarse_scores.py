# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Coarse scores: the similarity of a query and all references by their global descriptors.

Both are whitened first, and the scores are summed along the drive.
"""

from collections.abc import Sequence

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.retrieval.whitening import (
    COARSE,
    DriveMean,
    products,
    statistics_of,
    sums_of,
    WhitenedReferences,
)
from convseq_ros.core.types import constants, Descriptor, Halves, Indices, Row
import numpy as np


@constants
class TRACK:
    """The sums along the drive; tuned by recall on drawn and real sets."""

    memory: float = 0.8  # share of a predecessor's sum that is passed on, per keyframe
    reach: int = 3  # largest number of places that a drive passes per keyframe


class Track:
    """
    Sums of coarse scores along the drive, one for each place.

    The sum of a place is its score plus 80 % of the last sum of the best place just before it. So
    one pass over the row replaces sequence matching at all velocities up to `reach`. In `both`
    directions, the places just after it count as well. Sums stay within a session.
    """

    def __init__(self, both: bool) -> None:
        self._both = both
        self.reset()

    def reset(self) -> None:
        self.sums: Row = np.zeros(0, np.float32)

    def update(self, row: Row, starts: Indices) -> None:
        """Take in the scores of the newest query (R,); sessions begin at `starts`."""
        before, old = self.sums, len(self.sums)
        if not old:
            self.sums = row.copy()
            return
        if len(row) > old:
            before = np.append(before, np.full(len(row) - old, before.min(), np.float32))
        best, bounds = before.copy(), starts[1:]
        for step in range(1, TRACK.reach + 1):
            earlier, later = before[:-step], before[step:]
            if len(bounds):  # nothing is passed on from one session to another
                crosses = np.zeros(len(row), np.bool_)
                for back in range(step):
                    crosses[bounds[bounds + back < len(row)] + back] = True
                earlier = np.where(crosses[step:], -np.inf, earlier)
                later = np.where(crosses[step:], -np.inf, later)
            np.maximum(best[step:], earlier, out=best[step:])
            if self._both:
                np.maximum(best[:-step], later, out=best[:-step])
        best *= TRACK.memory
        best += row
        self.sums = best


_GROUP = 64  # size of the groups of scores whose maxima are compared first


class AllPlaces:
    """
    Selects the places that a query is scored with: all of them, as in the paper (III-D).

    A subclass selects the likely places.
    """

    _usable = 0

    def reset(self) -> None: ...

    def update(self, _descriptor: Descriptor, usable: int) -> None:
        """Take in a query, each only once, which may match the first `usable` references."""
        self._usable = usable

    def best(self, _by_track: int, _by_frame: int, excluded: Sequence[range] = ()) -> Indices:
        """
        Return the likeliest places, ascending, without those in the ranges `excluded`.

        `by_track` of them are chosen by the sums along the drive, `by_frame` by the newest query.
        """
        everywhere = np.arange(self._usable)
        without = [np.arange(part.start, part.stop) for part in excluded]
        return np.setdiff1d(everywhere, np.concatenate(without)) if without else everywhere

    def like(self, _place: int, _earlier: int, _count: int, _excluded: Sequence[range]) -> Indices:
        """Return no places: without descriptors, none is known to be like another."""
        return np.zeros(0, np.int64)


class CoarseScores(AllPlaces):
    """
    Scores a query against all references: 1.5 ms and 50 MB at 100,000, in proportion to the map.

    The means of the session and of the drive are subtracted: this removes what night, season or
    surroundings do to every image. Numbers are divided by the fourth root of their standard
    deviation in both, so that those that lamps change most do not dominate.
    """

    def __init__(self, reference_map: ReferenceMap, both: bool = False) -> None:
        self._map, self._track = reference_map, Track(both)
        self.row: Row = np.zeros(0, np.float32)  # cosines with the first references
        self._begin(reference_map.global_descriptors[:0])

    def _begin(self, nothing: Halves) -> None:
        """Start without places; the vectors' length is known from a model's first one."""
        numbers = nothing.shape[1]
        self._sums, self._counted = np.zeros((2, numbers)), 0
        self._statistics, self._drive = statistics_of(self._sums, 0), DriveMean(numbers)
        self._whitened = WhitenedReferences(self._statistics, nothing, np.zeros(1, np.int64))

    def reset(self) -> None:
        self._drive.reset()
        self._track.reset()

    def update(self, descriptor: Descriptor, usable: int | None = None) -> None:
        """Take in a query, each only once; `row` then has its scores, (usable,)."""
        references, starts = self._map.global_descriptors[:usable], self._map.bounds.starts
        if references.shape[1] != self._sums.shape[1]:
            self._begin(references[:0])
        self._follow_map(references, starts)
        direction = self._drive.update(descriptor, self._statistics)
        self.row = self._whitened.row(references, starts, direction)
        self._track.update(self.row, starts)

    def best(self, by_track: int, by_frame: int, excluded: Sequence[range] = ()) -> Indices:
        """Return the likeliest places, ascending: see `AllPlaces.best`."""
        track, frame = top(self._track.sums, by_track, excluded), top(self.row, by_frame, excluded)
        return np.union1d(track, frame)

    def like(self, place: int, earlier: int, count: int, excluded: Sequence[range]) -> Indices:
        """Return which of the first `earlier` places are most like one, ascending."""
        described = self._map.global_descriptors
        likeness = products(described[:earlier], described[place].astype(np.float32))
        return np.sort(top(likeness, count, excluded))

    def _follow_map(self, references: Halves, starts: Indices) -> None:
        if len(references) > COARSE.averaged_anew * self._counted:
            self._sums += sums_of(references[self._counted :])
            self._counted = len(references)
            self._statistics = statistics_of(self._sums, self._counted)
            self._whitened = WhitenedReferences(self._statistics, references, starts)
        self._whitened.follow(references, starts)


def top(scores: Row, count: int, excluded: Sequence[range] = ()) -> Indices:
    """Return the indices of the `count` best scores, best first, none in ranges `excluded`."""
    if excluded:
        scores = scores.copy()
        for indices in excluded:
            scores[max(0, indices.start) : max(0, indices.stop)] = -np.inf
    if not count:
        return np.zeros(0, np.int64)
    groups = len(scores) // _GROUP
    if groups > count:
        # `count` groups have a maximum of at least this threshold, so no best score is below it.
        best = scores[: groups * _GROUP].reshape(_GROUP, groups).max(axis=0)
        likely = np.flatnonzero(scores >= np.partition(best, groups - count)[groups - count])
    else:
        likely = np.arange(len(scores))
    best_first = likely[np.argsort(-scores[likely], kind='stable')][:count]
    return best_first[np.isfinite(scores[best_first])]
