# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The observation: which places a frame is compared with, and what it says of each.

The likeliest places get rough scores; the best of them, and the best elsewhere, the controls, get
pair scores; the best of these are verified. The likelihood judges what is found.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from convseq_ros.core.decision.decider import apart
from convseq_ros.core.decision.likelihood import Leads, Likelihood, RATIO, strength_of
from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.graph.links import LINKS
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.sequence.coarse_scores import Coarse
from convseq_ros.core.sequence.query_buffer import QueryBuffer
from convseq_ros.core.types import constants, Doubles, Flags, Indices, Row
import numpy as np


@constants
class OBSERVED:
    """Which places are looked at, beside the shortlist."""

    # In the first frames of a drive, up to its first match, for its own look is not known yet: on
    # drawn nights some 130 of 1,083 places, in the median, have a better coarse score than the
    # right one.
    first_frames: int = 15
    first_listed: int = 400  # places, the likeliest by the newest frame alone
    # Of the listed places, so many are scored in full: the best by rough scores. On `laps`,
    # 8 lose 2 % of the matches, and 16 gain nothing.
    scored: int = 12
    first_scored: int = 30  # in the first frames
    peaks: int = 6  # best by pair score, apart from each other, that are verified; as many are
    # scored that were the likeliest by what was believed before, and of these ...
    checked: int = 2  # so many are verified whatever their pair score
    beside: int = 2  # places to either side of the best that are verified, too
    fewest: int = 8  # scored controls without which nothing speaks for a place


class Neighbourhood:
    """Knows which places of a map show much the same as one of them."""

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map

    def ranges(self, index: int, distance: int = LINKS.beside) -> list[range]:
        """Return the places of each session within a distance of a place, or of a look of it."""
        looks = (index, *self._map.links.looks(index))
        return [self._map.bounds.around(one, distance) for one in looks]

    def mask(self, places: Indices, index: int, distance: int = LINKS.beside) -> Flags:
        """Return which of some places (n,) are near one."""
        found = np.zeros(len(places), np.bool_)
        for some in self.ranges(index, distance):
            found |= (places >= some.start) & (places < some.stop)
        return found

    def beside(self, places: Indices, index: int, distance: int) -> Flags:
        """Return which of some places (n,) are of the same session, within a distance."""
        return self._map.bounds.near(places, index, distance)

    def best_beside(
        self, places: Indices, others: Indices, values: Doubles, reach: int, loss: float = 0.0
    ) -> Doubles:
        """
        Return of places (n,) the best value of others (m,) at most so far off in their session.

        It is less by so much for each place between; -inf where there is none.
        """
        near = self._map.bounds.nearness(places, others, reach)
        found = values[:, None] - loss * abs(places - others[:, None])
        return np.where(near, found, -np.inf).max(axis=0, initial=-np.inf)

    def is_near(self, one: int, other: int, distance: int = LINKS.beside) -> bool:
        """Return whether a place is near another."""
        return any(one in some for some in self.ranges(other, distance))


@dataclass(frozen=True, eq=False, slots=True)
class Observation:
    """What a frame says of the places that were looked at."""

    places: Indices  # (n,), ascending
    log_ratios: Doubles  # (n,)
    verified: Mapping[int, Verification]
    has_rivals: bool  # enough controls to tell a match
    leads: Leads | None = None  # of the verified places


class Observer:
    """Looks at the frames of one camera's drive."""

    def __init__(self, coarse: Coarse, near: Neighbourhood, listed: int) -> None:
        self._coarse, self._near, self._listed = coarse, near, listed
        self.likelihood = Likelihood()
        self.reset()

    def reset(self) -> None:
        self._coarse.reset()
        self.likelihood.reset()
        self._frames = 0  # of the drive

    def end_search(self) -> None:
        """Look at fewer places from now on: the drive has its first match."""
        self._frames = OBSERVED.first_frames

    def observe(
        self, buffer: QueryBuffer, believed: Indices, predicted: Sequence[int], session_start: int
    ) -> Observation:
        """
        Look at the newest frame, which shows something.

        Returned are places that were scored, and all that are `believed`, (n,), ascending;
        `predicted` are the likeliest of these, best first. Places from a start on were seen on
        this very drive.
        """
        self._frames += 1
        is_first = self._frames <= OBSERVED.first_frames
        newest = OBSERVED.first_listed if is_first else self._listed // 4
        likely = self._coarse.best(self._listed, newest)
        before = np.array(predicted, np.int64)
        most = OBSERVED.first_scored if is_first else OBSERVED.scored
        likely = self._promising(buffer, np.union1d(likely, before), most)
        places, scores = _scored(buffer, np.union1d(likely, before))
        if not len(places):
            return Observation(believed, np.zeros(len(believed)), {}, False)
        peaks = self._peaks(places, scores, OBSERVED.peaks)
        checked = [one for one in predicted[: OBSERVED.checked] if one in places]
        verified = buffer.verified([*peaks, *checked])
        best = _strongest(verified, peaks[0])
        beside = places[self._near.beside(places, best, OBSERVED.beside)]
        verified |= buffer.verified(beside.tolist())
        best = _strongest(verified, best)
        if len(self._elsewhere(places, best)) < OBSERVED.fewest:
            others = self._coarse.best(OBSERVED.fewest, 0, self._near.ranges(best))
            places, scores = _scored(buffer, np.union1d(places, others))
            away = self._elsewhere(places, best)
            more = self._peaks(away, scores[np.searchsorted(places, away)], OBSERVED.peaks - 1)
            verified |= buffer.verified(more)
            peaks += more
        seen = self._judged(buffer, places, scores, verified, peaks, session_start)
        # An image that shows the same again speaks for no place again.
        log_ratios = np.where(seen.log_ratios > 0, buffer.novelty, 1.0) * seen.log_ratios
        return self._with(replace(seen, log_ratios=log_ratios), believed)

    def _promising(self, buffer: QueryBuffer, places: Indices, most: int) -> Indices:
        """Return the best of some places by rough scores, the fewest controls among them."""
        rough = buffer.rough_scores(places) if len(places) > most else None
        if rough is None:
            return places
        order = np.argsort(-np.nan_to_num(rough, nan=-1.0), kind='stable')
        is_near = self._near.mask(places, int(places[order[0]]))[order]
        near_by, away = places[order[is_near]], places[order[~is_near]]
        controls = min(len(away), max(OBSERVED.fewest, most - len(near_by)))
        return np.r_[near_by[: most - controls], away[:controls]]

    def _judged(
        self,
        buffer: QueryBuffer,
        places: Indices,
        scores: Doubles,
        verified: Mapping[int, Verification],
        peaks: Sequence[int],
        session_start: int,
    ) -> Observation:
        judge = self.likelihood
        log_ratios = np.full(len(places), judge.unseen)
        if not verified:
            return Observation(places, np.minimum(log_ratios, 0.0), verified, False)
        order = sorted(verified)
        looked, is_peak = np.array(order), np.array([one in peaks for one in order])
        at, is_own = np.searchsorted(places, looked), looked >= session_start
        strengths = np.array([strength_of(verified[one]) for one in looked.tolist()])
        best = int(strengths.argmax())
        is_rival = is_peak & ~self._near.mask(looked, int(looked[best]))
        is_hypothesis = judge.hypotheses(strengths, is_own)
        if is_hypothesis[best]:
            is_rival &= ~is_hypothesis
        controls = self._elsewhere(places, int(looked[best]))
        has_rivals = len(controls) >= OBSERVED.fewest and bool(is_rival.any())
        leads = judge.judge(strengths, scores[at], is_rival)
        log_ratios[at] = leads.log_ratios
        if not has_rivals:  # then nothing is likelier than elsewhere, but the best is the best
            best_ratio = max(0.0, float(log_ratios.max()))
            log_ratios = np.maximum(log_ratios - best_ratio, RATIO.least)
        # One frame cannot tell a place from those beside it.
        beside = OBSERVED.beside, RATIO.beside
        smoothed = self._near.best_beside(looked, looked, log_ratios[at], *beside)
        log_ratios[at] = np.maximum(smoothed, judge.support(strengths, is_own))
        step = buffer.verified_step if is_own.any() else None
        doubts = judge.doubts(strengths, is_own, step)
        # On its own drive, light and camera are the same, and nothing makes up for a doubt.
        is_doubted = is_own & (doubts < 0)
        found = np.where(is_doubted, np.minimum(log_ratios[at], 0.0), log_ratios[at])
        log_ratios[at] = found + doubts
        return Observation(places, log_ratios, verified, has_rivals, leads)

    def _with(self, seen: Observation, believed: Indices) -> Observation:
        """Return an observation with more places; beside what is denied, others are, too."""
        places = np.union1d(seen.places, believed)
        looked = np.array(sorted(seen.verified), np.int64)
        log_ratios = np.full(len(places), self.likelihood.unseen)
        at = np.searchsorted(places, seen.places)
        log_ratios[at] = seen.log_ratios
        if not len(looked):
            return replace(seen, places=places, log_ratios=log_ratios)
        ratios = seen.log_ratios[np.searchsorted(seen.places, looked)]
        best = self._near.best_beside(places, looked, ratios, LINKS.beside // 2)
        unknown = np.isfinite(best)
        unknown[np.searchsorted(places, looked)] = False
        log_ratios[unknown] = np.minimum(log_ratios[unknown], best[unknown])
        return replace(seen, places=places, log_ratios=log_ratios)

    def _peaks(self, places: Indices, scores: Doubles, count: int) -> list[int]:
        """Return the best places by pair score that are not near each other, best first."""
        found = apart(scores, count, lambda at: self._near.mask(places, int(places[at])))
        return places[found].tolist()

    def _elsewhere(self, places: Indices, best: int) -> Indices:
        return places[~self._near.mask(places, best)]


def _strongest(verified: Mapping[int, Verification], otherwise: int) -> int:
    """Return the place that is verified best, the first of equals."""
    return max(verified, key=lambda one: strength_of(verified[one]), default=otherwise)


def _scored(buffer: QueryBuffer, places: Indices) -> tuple[Indices, Doubles]:
    """Return places that show something, ascending, and their pair scores."""
    buffer.score(1, places)
    row: Row = buffer.rows[0] if buffer.rows[0] is not None else np.zeros(0, np.float32)
    scores = row[places].astype(np.float64)
    known = np.isfinite(scores)
    return places[known], scores[known]
