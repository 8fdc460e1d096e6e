# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How strongly the last frames together speak for one place, in units that need no site's threshold.

One frame alone can look like another place by chance; at a true place the best diagonal stays the
best. So margins beyond chance are summed along it and divided by how much other places scatter. A
track ends where its newest frame ends it: where a road forks, nine of ten show the known one.
"""

from dataclasses import dataclass, replace
import math

from convseq_ros.core.constants import constants
from convseq_ros.core.decision.neighbourhood import Neighbourhood
from convseq_ros.core.decision.usual_scores import UsualScores
from convseq_ros.core.sequence.diagonals import Rows, Values
from convseq_ros.core.types import Indices
import numpy as np


@constants
class TRACK:
    """Chosen on the drawn drives of scripts/fit_acceptance.py and on real images made dark."""

    own_peak: int = 5  # references from the best that its own peak covers
    same_track: int = 2  # references by which two frames of one diagonal may differ
    border: int = 2  # references of a session where a drive leaves it: a peak may lie beyond
    window: int = 8  # frames of a diagonal whose scores are compared
    few: int = 3  # newest of these, by which a place that is just entered is likely
    memory: int = 30  # frames over which margins are summed
    fewest_rivals: int = 8  # other places, without which a margin says nothing
    chance: float = 6.0  # scatters by which the best of one rival's neighbours leads by chance
    prior_windows: int = 2  # that the usual scatter counts for
    usual_scatter: float = 0.006  # of sequence scores of other places
    least_scatter: float = 0.001  # added to it, as sets of few places scatter too little
    shortest_drive: int = 20  # frames that the mean is taken over at least
    doubt_of_other_velocities: float = 1.5  # by which evidence is divided, as there are many


@dataclass(frozen=True, slots=True)
class FrameEvidence:
    """What one frame says."""

    frame: int  # its number
    reference: int  # where the best diagonal ends
    # By how much it beats those of other places, beyond chance; 0 among too few rivals and at the
    # border of its session, where the peak may lie beyond.
    margin: float
    rivals: int  # diagonals further than the rivals' distance from the best
    verified: float = 0.0  # what geometry adds to the margin, in scatters

    @property
    def enough_rivals(self) -> bool:
        return self.rivals >= TRACK.fewest_rivals


class TrackEvidence:
    """
    Follows the best diagonal through a drive; causal.

    Scores count relative to what each reference usually scores on this drive, away from where the
    last frames lead, and to the row's mean, so that a pair that was not scored (shortlist) is
    average. A window of 8 frames, whatever the sequence length k, keeps the scatter comparable.
    """

    def __init__(self, neighbourhood: Neighbourhood | None = None) -> None:
        self._places = neighbourhood or Neighbourhood()
        self._usual = UsualScores(self._places.bounds)
        self._frames: list[FrameEvidence] = []
        self._variance, self._windows = 0.0, 0
        self._start: int | None = None
        self._ends, self._now, self._rival_distance = np.zeros(0, np.int64), np.zeros(0), 0
        self._window, self._scores = np.zeros((0, 0)), np.zeros(0)

    @property
    def scatter(self) -> float | None:
        """How much other places scatter on this drive; None before that is known."""
        if not self._windows:
            return None
        variance = self._variance + TRACK.prior_windows * TRACK.usual_scatter**2
        windows = self._windows + TRACK.prior_windows
        return math.sqrt(variance / windows) + TRACK.least_scatter

    def update(
        self, frame: int, rows: Rows, ends: Indices, rival_distance: int, velocity: float = 1.0
    ) -> FrameEvidence | None:
        """Take in a frame, by its number, with the last 8 rows; return what it says, if any."""
        if (newest := rows[0]) is None:
            raise ValueError('the newest frame must be informative')
        self._frames = [one for one in self._frames if one.frame > frame - TRACK.memory]
        window = self._usual.above(rows[: TRACK.window], ends, velocity)
        self._ends, self._now, self._rival_distance = ends, window[0], rival_distance
        # An eighth of the sums along diagonals, (n,); NaN where half of the pairs have no score.
        scored = np.isfinite(window)
        scores = np.where(scored, window, 0.0).sum(axis=0) / TRACK.window
        scores[2 * scored.sum(axis=0) < len(window)] = np.nan
        self._window, self._scores = window, scores
        known = np.flatnonzero(np.isfinite(scores + self._now))
        if not len(known):
            self._usual.learn(newest, ends)
            return None
        top = known[scores[known].argmax()]
        best, margin = int(ends[top]), 0.0
        self._places.follow(best, ends, scores, rival_distance, TRACK.own_peak)
        elsewhere = self._beyond(scores, best, rival_distance)
        if len(elsewhere) >= TRACK.fewest_rivals:
            if len(window) == TRACK.window:
                self._variance += float(elsewhere.var())
                self._windows += 1
            if not self._is_last(best, velocity):
                rivals = self._beyond(scores, best, TRACK.own_peak)
                chance = TRACK.chance * (self.scatter or 0.0) / math.sqrt(len(elsewhere))
                margin = max(0.0, float(scores[top] - rivals.max()) - chance)
        self._frames.append(FrameEvidence(frame, best, margin, len(elsewhere)))
        along = self._along(frame, best, velocity)
        is_tracked = 2 * sum(one.frame > frame - TRACK.window for one in along) >= TRACK.window
        away = ~self._places.near(ends, best, rival_distance)
        self._usual.learn(newest, ends[away] if is_tracked else ends)
        return self._frames[-1]

    def evidence(self, frame: int, reference: int, velocity: float = 1.0) -> float | None:
        """
        Return how strongly the last 30 frames, and the newest, say that it shows a reference.

        The mean margin, in scatters and with what geometry adds, of those whose own best diagonal
        is this one, others 0; early in a drive over 20 frames at least. No more than the standard
        deviations by which the newest alone speaks for it; a third less at another velocity than
        1. On a slower drive than the map's the two references where it leaves their session say
        nothing, as one that has left sees its end. None while the scatter is unknown.
        """
        if self._start is None and self._frames and self._frames[-1].enough_rivals:
            self._start = frame
        if (scatter := self.scatter) is None:
            return None
        if (is_slower := abs(velocity) < 1.0) and self._is_last(reference, velocity):
            return 0.0
        started = frame if self._start is None else self._start
        frames = min(max(frame - started + 1, TRACK.shortest_drive), TRACK.memory)
        along = self._along(frame, reference, velocity)
        if is_slower:
            along = [one for one in along if not self._is_last(one.reference, velocity)]
        sums = sum(one.margin / scatter + one.verified for one in along)
        evidence = min(sums / frames, self._newest_alone(reference))
        return evidence if velocity == 1.0 else evidence / TRACK.doubt_of_other_velocities

    def share(self, frame: int, reference: int, velocity: float = 1.0) -> float:
        """Return the share of the last frames, of 20 at least, whose best diagonal is this one."""
        frames = max(len(self._frames), TRACK.shortest_drive)
        return len(self._along(frame, reference, velocity)) / frames

    def likely(self) -> list[int]:
        """
        Return the places that the newest frame may show, of one place one end.

        These end the best diagonals of 1 frame, of 3 and of 8, as what has just been entered is
        best seen by the newest; and the best elsewhere than the last of these, of 8 and of 1.
        """
        few = self._window[: TRACK.few]
        sums = np.where(np.isfinite(few), few, 0.0).sum(axis=0)
        known = np.isfinite(self._now) & (2 * np.isfinite(few).sum(axis=0) > len(few))
        of_few = np.where(known, sums / len(few), np.nan)
        kinds = self._now, of_few, self._scores
        best = [int(self._ends[np.nanargmax(one)]) for one in kinds if np.isfinite(one).any()]
        elsewhere = ~self._places.near(self._ends, best[-1], self._rival_distance)
        for one in (self._scores, self._now):
            beyond = np.isfinite(one) & elsewhere
            if beyond.any():
                best.append(int(self._ends[np.where(beyond, one, -np.inf).argmax()]))
        apart: list[int] = []
        for end in best:
            if not any(end in self._places.bounds.around(one, TRACK.same_track) for one in apart):
                apart.append(end)
        return apart

    def verify(self, verified: float) -> None:
        """Add to the newest frame's evidence what geometry says of it."""
        self._frames[-1] = replace(self._frames[-1], verified=verified)

    def lead(self, reference: int) -> float:
        """Return by how many standard deviations the newest frame alone prefers a reference."""
        elsewhere = self._beyond(self._now, reference, self._rival_distance)
        near = self._now[self._places.bounds.near(self._ends, reference, 1)]
        if len(elsewhere) < TRACK.fewest_rivals or not np.isfinite(near).any():
            return 0.0
        above = float(np.nanmax(near) - elsewhere.max())
        return above / (float(elsewhere.std()) + TRACK.least_scatter)

    def _along(self, frame: int, reference: int, velocity: float) -> list[FrameEvidence]:
        """Return the frames whose best diagonal leads to a reference, or another look of it."""
        found: list[FrameEvidence] = []
        for end in (reference, *self._places.looks(reference)):
            first, last = self._places.bounds.span(end)
            found += [
                one
                for one in self._frames
                if first <= one.reference < last
                and abs(end - one.reference - velocity * (frame - one.frame)) <= TRACK.same_track
            ]
        return found

    def _newest_alone(self, reference: int) -> float:
        """Return by how many standard deviations the newest frame speaks for a reference."""
        elsewhere = self._beyond(self._now, reference, self._rival_distance)
        near = self._now[self._places.near(self._ends, reference, TRACK.same_track)]
        if len(elsewhere) < TRACK.fewest_rivals or not np.isfinite(near).any():
            return np.inf
        above = float(np.nanmax(near) - elsewhere.mean())
        return above / (float(elsewhere.std()) + TRACK.least_scatter)

    def _is_last(self, reference: int, velocity: float) -> bool:
        """Return whether a drive leaves a reference's session there, or may have left it."""
        first, end = self._places.bounds.span(reference)
        if velocity < 0:
            return reference < first + TRACK.border
        return reference >= min(end, len(self._usual)) - TRACK.border

    def _beyond(self, scores: Values, best: int, distance: int) -> Values:
        """Return what is known further than a distance from the best, and other looks of it."""
        return scores[~self._places.near(self._ends, best, distance) & np.isfinite(scores)]
