# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shortlist: which sequences get a full pair score, by sums of their coarse scores."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from convseq_ros.core.constants import constants
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence.coarse_sums import Asked, enough, Sums, top
from convseq_ros.core.sequence.diagonals import diagonal, ONE_SESSION, Values
from convseq_ros.core.types import Indices
import numpy as np

_NONE = np.zeros(0, np.int64)


@constants
class SHORTLIST:
    """Of the choice; by recall of the right place on halves of real maps (docs/MATCHING.md)."""

    known: float = 0.6  # share that is listed once the last frame's place is known: it needs less
    elsewhere: int = 4  # one of so many lies no nearer to another than the rivals' distance
    hysteresis: float = 0.5  # standard deviations by which a listed one is preferred
    admission: int = 7  # one of so many may be new; a new one costs a whole sequence of pairs
    verified: int = 5  # one of so many, the best by pair scores, stays whatever its coarse score
    scouts: int = 6  # places that are likely by the newest frame alone, which get one pair each
    entered: int = 2  # best of these that are listed: a map may just have been entered there
    # The same in the first frames of a drive, whose own look is not known yet: on drawn nights
    # some 130 of 1,083 places, in the median, have a better coarse score than the right one.
    first_frames: int = 15
    first_scouts: int = 400
    first_entered: int = 10
    single_scouts: int = 200  # of single frames, which no sequence finds: 100 pairs take some 7 ms
    # Likeliest of these around which all places of a peak are listed, so many on either side: one
    # of them may be the best, or tell where the middle is.
    peaks: int = 3
    reach: int = 4
    closer: int = 20  # likeliest sequences that are scored for a second velocity; a few ms


class Shortlist:
    """Lists the sequence end indices of best coarse scores; a quarter of them are rivals."""

    def __init__(self, length: int, bounds: SessionBounds = ONE_SESSION) -> None:
        self._most, self._bounds = length, bounds
        self.reset()

    def reset(self) -> None:
        self._length = self._most
        self._newest: Any = None
        self._listed = self._verified = _NONE

    def asked(self, rows: Sequence[Any], rival_distance: int, velocity: float = 1.0) -> Asked:
        """Return which sums `update` needs."""
        known = np.union1d(*self._carried(rows, velocity))
        return Asked(rows, velocity, enough(self._length, rival_distance), known)

    def update(self, asked: Asked, sums: Sums, rival_distance: int) -> Indices:
        """Return the ends, ascending, of diagonals by coarse scores; a seventh at most are new."""
        before, verified = self._carried(asked.rows, asked.velocity)
        self._verified, scores = _NONE, sums.scores.copy()
        if len(before) and sums.spread.count:
            scores[sums.at(before)] += SHORTLIST.hysteresis * sums.spread.deviation
            scores[sums.at(verified)] += sums.spread.range
        listed = self._best(replace(sums, scores=scores), self._length, rival_distance)
        if len(before):
            carried = set(before.tolist())
            new = [index for index in listed if index not in carried]
            admitted = max(1, self._length // SHORTLIST.admission)
            listed = list(set(listed).difference(new[admitted:]))
        self._newest, self._listed = asked.rows[0], np.array(sorted(listed), np.int64)
        return self._listed

    def top(self, sums: Sums, rival_distance: int, length: int) -> Indices:
        """Return the best so many sequence end indices, ascending, whatever was listed before."""
        return np.array(sorted(self._best(sums, length, rival_distance)), np.int64)

    def around(self, best: Indices, usable: int) -> Indices:
        """Return the places of the likeliest single peaks, of the first `usable` ones."""
        peaks = [self._bounds.around(one, SHORTLIST.reach) for one in best[: SHORTLIST.peaks]]
        found = np.array([place for peak in peaks for place in peak], np.int64)
        return found[found < usable]

    def verify(self, ends: Indices, scores: Values, is_known: bool = False) -> None:
        """
        Take note of how listed sequences have scored, pair by pair; a fifth stays listed.

        If it is known which place the frame shows, the next list is shorter.
        """
        self._length = int(SHORTLIST.known * self._most) if is_known else self._most
        best = np.argsort(-scores, kind='stable')[: self._length // SHORTLIST.verified]
        self._verified = ends[best]

    def _carried(self, rows: Sequence[Any], velocity: float) -> tuple[Indices, Indices]:
        """Return where diagonals that were listed, and verified, for an older frame end now."""
        for step, row in zip(diagonal(len(rows), velocity), rows, strict=True):
            if row is not None and row is self._newest:
                return self._later(self._listed, step, len(row)), self._later(
                    self._verified, step, len(row)
                )
        return _NONE, _NONE

    def _later(self, ends: Indices, step: int, usable: int) -> Indices:
        """Return places so many further on in their sessions, of those that have such a one."""
        later = ends + step
        firsts, stops = self._bounds.spans(ends)
        return later[(later >= firsts) & (later < np.minimum(stops, usable))]

    def _best(self, sums: Sums, length: int, rival_distance: int) -> list[int]:
        """Return the best, and for the last quarter the best elsewhere."""
        elsewhere, scores = length // SHORTLIST.elsewhere, sums.scores.copy()
        best = top(scores, length - elsewhere)
        best = best[np.argsort(-scores[best], kind='stable')][: length - elsewhere]
        listed = sums.ends[best[np.isfinite(scores[best])]].tolist()
        passed = list(listed)
        for _ in range(elsewhere if listed else 0):
            near = [self._bounds.around(index, rival_distance) for index in passed]
            for start, stop in sums.at(np.array([(each.start, each.stop) for each in near])):
                scores[start:stop] = -np.inf
            best_elsewhere = int(scores.argmax())
            if not np.isfinite(scores[best_elsewhere]):
                break
            passed = [int(sums.ends[best_elsewhere])]
            listed += passed
        return listed
