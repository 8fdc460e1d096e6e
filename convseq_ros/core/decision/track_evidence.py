# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How strongly the last frames together speak for one place, in units that need no site's threshold.

One frame alone can look like another place by chance; at a true place the best diagonal stays the
best, frame after frame. So the margins over other places, less what chance gives, are summed along
the diagonal and divided by how much other places scatter on this drive; the fewer of them there
are, the less it means to beat them. And a track ends where its newest frame ends it: where a road
forks, nine frames of ten still show the known one.
"""

from collections import deque
from dataclasses import dataclass
import math

from convseq_ros.core.decision.usual_scores import UsualScores
from convseq_ros.core.sequence.diagonals import Indices, Rows, Values
import numpy as np


@dataclass(frozen=True, slots=True)
class TrackConstants:
    """
    Of the evidence.

    Chosen on the drawn drives of scripts/fit_acceptance.py and on real images made dark, neither
    of which is reported, but for the first three, which say what a place is.
    """

    own_peak: int = 5  # references from the best that its own peak covers
    same_track: int = 2  # references by which two frames of one diagonal may differ
    border: int = 2  # last references of the map, beyond which a peak may lie
    window: int = 8  # frames of a diagonal whose scores are compared
    memory: int = 30  # frames over which margins are summed
    fewest_rivals: int = 8  # other places, without which a margin says nothing
    chance: float = 6.0  # scatters by which the best of one rival's neighbours leads by chance
    prior_windows: int = 2  # that the usual scatter counts for
    usual_scatter: float = 0.006  # of sequence scores of other places
    least_scatter: float = 0.001  # added to it, as sets of few places scatter too little
    shortest_drive: int = 20  # frames that the mean is taken over at least
    doubt_of_other_velocities: float = 1.5  # by which evidence is divided, as there are many


TRACK = TrackConstants()


@dataclass(frozen=True, slots=True)
class FrameEvidence:
    """
    What one frame says.

    The margin is by how much the best diagonal beats those of other places, beyond what chance
    gives; 0 at the border of the map, where the peak may lie beyond, and among too few rivals.
    """

    frame: int  # its number
    reference: int  # where the best diagonal ends
    margin: float
    rivals: int  # diagonals further than the rivals' distance from the best

    @property
    def enough_rivals(self) -> bool:
        """Whether there were other places to compare with."""
        return self.rivals >= TRACK.fewest_rivals


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
        self._usual = UsualScores()
        self._variance, self._windows = 0.0, 0
        self._start: int | None = None
        self._frames: deque[FrameEvidence] = deque()
        self._ends: Indices = np.zeros(0, np.int64)
        self._now: Values = np.zeros(0)
        self._rival_distance = 0

    @property
    def scatter(self) -> float | None:
        """How much other places scatter on this drive; None before that is known."""
        if not self._windows:
            return None
        variance = self._variance + TRACK.prior_windows * TRACK.usual_scatter**2
        windows = self._windows + TRACK.prior_windows
        return float(np.sqrt(variance / windows)) + TRACK.least_scatter

    def update(
        self, frame: int, rows: Rows, ends: Indices, rival_distance: int, velocity: float = 1.0
    ) -> FrameEvidence | None:
        """
        Take in a frame, by its number, and return what it says, if it says anything.

        Rows are as for `sequence_scores`, 8 as soon as there are so many; frames that are passed
        over leave a gap in the numbers. References within the rivals' distance are one place.
        """
        newest = rows[0]
        if newest is None:
            raise ValueError('the newest frame must be informative')
        while self._frames and self._frames[0].frame <= frame - TRACK.memory:
            self._frames.popleft()
        self._rival_distance = rival_distance
        window = self._usual.above(rows[: TRACK.window], ends, velocity)
        self._ends, self._now = ends, window[0]
        scores = _means(window)
        known = np.flatnonzero(np.isfinite(scores + self._now))
        if not len(known):
            self._usual.learn(newest, ends)
            return None
        top = known[scores[known].argmax()]
        best = int(ends[top])
        elsewhere = _beyond(scores, ends, best, rival_distance)
        margin = 0.0
        if len(elsewhere) >= TRACK.fewest_rivals:
            if len(window) == TRACK.window:
                self._variance += float(elsewhere.var())
                self._windows += 1
            if best < len(newest) - TRACK.border:
                rivals = _beyond(scores, ends, best, TRACK.own_peak)
                chance = TRACK.chance * (self.scatter or 0.0) / math.sqrt(len(elsewhere))
                margin = max(0.0, float(scores[top] - rivals.max()) - chance)
        said = FrameEvidence(frame, best, margin, len(elsewhere))
        self._frames.append(said)
        along = self._along(frame, best, velocity)
        lately = [one for one in along if one.frame > frame - TRACK.window]
        is_tracked = 2 * len(lately) >= TRACK.window
        away = abs(ends - best) > rival_distance
        self._usual.learn(newest, ends[away] if is_tracked else ends)
        return said

    def evidence(self, frame: int, reference: int, velocity: float = 1.0) -> float | None:
        """
        Return how strongly the last 30 frames, and the newest, say that it shows a reference.

        The mean margin of those frames whose own best diagonal is this one, in units of the
        scatter; frames that are missing or point elsewhere count as 0. Early in a drive the mean
        is over the frames since there were rivals, 20 at least. No more, however, than the
        standard deviations by which the newest frame alone speaks for the place; and a third less
        at another velocity than 1, of which there are many. 0 for the last two references if the
        query drives more slowly than the map: so it looks to a drive that has left the map and
        still sees its end. None while the scatter is unknown.
        """
        if self._start is None and self._frames and self._frames[-1].enough_rivals:
            self._start = frame
        if self.scatter is None:
            return None
        if velocity < 1.0 and reference >= len(self._usual) - TRACK.border:
            return 0.0
        started = frame if self._start is None else self._start
        margins = [one.margin for one in self._along(frame, reference, velocity)]
        frames = min(max(frame - started + 1, TRACK.shortest_drive), TRACK.memory)
        along = min(sum(margins) / (frames * self.scatter), self._newest_alone(reference))
        return along if velocity == 1.0 else along / TRACK.doubt_of_other_velocities

    def _along(self, frame: int, reference: int, velocity: float) -> list[FrameEvidence]:
        """Return the frames on the diagonal that ends at a reference."""
        return [
            one
            for one in self._frames
            if abs(reference - one.reference - velocity * (frame - one.frame)) <= TRACK.same_track
        ]

    def _newest_alone(self, reference: int) -> float:
        """Return by how many standard deviations the newest frame speaks for a reference."""
        elsewhere = _beyond(self._now, self._ends, reference, self._rival_distance)
        near = self._now[abs(self._ends - reference) <= TRACK.same_track]
        if len(elsewhere) < TRACK.fewest_rivals or not np.isfinite(near).any():
            return np.inf
        above = float(np.nanmax(near) - elsewhere.mean())
        return above / (float(elsewhere.std()) + TRACK.least_scatter)


def _means(window: Values) -> Values:
    """
    Return an eighth of the sums (n,) of pairs along diagonals (k, n).

    A pair that was not scored counts as 0; where half of them are missing, there is NaN.
    """
    known = np.isfinite(window)
    total = np.where(known, window, 0.0).sum(axis=0)
    return np.where(2 * known.sum(axis=0) >= len(window), total / TRACK.window, np.nan)


def _beyond(scores: Values, ends: Indices, best: int, distance: int) -> Values:
    """Return what is known further than a distance from the best."""
    known: Values = scores[(abs(ends - best) > distance) & np.isfinite(scores)]
    return known
