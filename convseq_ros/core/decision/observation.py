# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The observation: how many times likelier a frame is at a place than elsewhere.

The likeliest places are scored; the best, and the hardest places elsewhere, its controls, are
verified. What counts is by how much a place leads the best control, in pair score and in strength.
Both leads are told in units of what the controls lead each other by: the best of many that are no
match scatter as a Gumbel distribution does, so the gaps between them are exponential, and their
mean is its scale. So a lead says the same in a forest and in a corridor of identical lockers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math

from convseq_ros.core.constants import constants
from convseq_ros.core.decision.neighbourhood import Neighbourhood
from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.graph.links import LINKS
from convseq_ros.core.sequence.coarse_scores import Coarse
from convseq_ros.core.sequence.query_buffer import QueryBuffer
from convseq_ros.core.types import Indices, Row
import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]


@constants
class OBSERVED:
    """Which places are looked at, beside the shortlist."""

    # In the first frames of a drive, whose own look is not known yet: on drawn nights some 130 of
    # 1,083 places, in the median, have a better coarse score than the right one.
    first_frames: int = 15
    first_listed: int = 400  # places, the likeliest by the newest frame alone
    predicted: int = 6  # places, the likeliest by what was believed before, and of these ...
    checked: int = 2  # so many are verified whatever their pair score
    peaks: int = 6  # best by pair score, apart from each other, that are verified
    beside: int = 2  # places to either side of the best that are verified, too
    fewest: int = 8  # scored controls without which nothing speaks for a place


@constants
class RATIO:
    """
    Of the log of the likelihood ratio.

    Chosen with corridor, laps and Gardens Point in view. scripts/fit_observation.py prints a
    logistic regression beside them: the weights are .6 and .9 of it, the constant is bolder by 3.
    """

    constant: float = -0.7  # without a lead
    strength: float = 0.4  # for a lead of one scale by verification
    score: float = 0.5  # for a lead of one scale by pair score ...
    most_scales: float = 5.0  # of which no more count: one alike house scores as a whole street
    unrelated: float = 30.0  # strength of unrelated images, in the middle of all sets
    # By which a place beside one that leads is less likely, for each place between them.
    beside: float = 0.25
    least: float = -2.0
    most: float = 6.5
    # Scales of the gaps between controls, before a drive has shown any, and how many frames these
    # count for; the power takes back part of what a drive shows, as it shows it late.
    prior_strength: float = 1.0  # in square roots of strength, doubled
    prior_score: float = 0.008
    memory: float = 20.0  # frames
    power: float = 0.7
    # A place that is shown far worse than true ones are on this drive is not true: the log of the
    # share of the usual strength, times this, below ...
    doubt: float = 2.5
    share: float = 0.5  # this share. On its own drive, usual is what the frame before has.
    level_memory: float = 5.0  # matches over which the usual strength is averaged


@dataclass(frozen=True, eq=False, slots=True)
class Leads:
    """By how much verified places lead their hardest control, in scales."""

    places: Indices  # (n,), ascending
    strength: Values  # (n,)
    score: Values  # (n,), of a bounded number of scales

    @property
    def log_ratios(self) -> Values:
        """The log ratios (n,), linear in both leads."""
        ratios = RATIO.constant + RATIO.strength * self.strength + RATIO.score * self.score
        return ratios.clip(RATIO.least, RATIO.most)


@dataclass(frozen=True, eq=False, slots=True)
class Observation:
    """What a frame says of the places that were looked at."""

    places: Indices  # (n,), ascending
    log_ratios: Values  # (n,)
    verified: Mapping[int, Verification]
    has_rivals: bool  # enough controls to tell a match
    leads: Leads | None = None  # of the verified places


class RecentMean:
    """The mean of the last values or so, and at first of what was usual before."""

    def __init__(self, usual: float, count: float) -> None:
        self._sum, self._count = usual * count, count

    @property
    def value(self) -> float:
        """The mean."""
        return self._sum / self._count

    def add(self, value: float) -> None:
        """Take in the newest value."""
        keep = 1 - 1 / RATIO.memory
        self._sum, self._count = keep * self._sum + value, keep * self._count + 1


def gumbel_scale(best: Values) -> float | None:
    """
    Return the scale of what scatters as the best of many do, given the best few (n,).

    The k-th gap between them is exponential, with the k-th part of the scale as its mean. None of
    fewer than three.
    """
    if len(best) < 3:
        return None
    gaps = -np.diff(np.sort(best)[::-1])[:3]
    return float((gaps * np.arange(1, len(gaps) + 1)).mean())


class Observer:
    """Looks at the frames of one camera's drive."""

    def __init__(self, coarse: Coarse, near: Neighbourhood, listed: int) -> None:
        self._coarse, self._near, self._listed = coarse, near, listed
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._coarse.reset()
        self._frames = 0  # of the drive
        self._strength_scale = RecentMean(RATIO.prior_strength, RATIO.memory / 2)
        self._score_scale = RecentMean(RATIO.prior_score, RATIO.memory / 2)
        self._level: float | None = None  # usual strength of a match, as a logarithm
        self._missed = RecentMean(0.5, 1.0)  # share of frames that do not show their place

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
        places, scores = _scored(buffer, np.union1d(likely, before))
        if not len(places):
            return Observation(believed, np.zeros(len(believed)), {}, False)
        peaks = self._peaks(places, scores, OBSERVED.peaks)
        shown = buffer.verified(peaks)
        best = max(shown, key=lambda one: strength_of(shown[one]), default=peaks[0])
        if len(self._elsewhere(places, best)) < OBSERVED.fewest:
            passed = self._near.ranges(best)
            others = self._coarse.best(OBSERVED.fewest, 0, passed)
            places, scores = _scored(buffer, np.union1d(places, others))
            away = self._elsewhere(places, best)
            peaks += self._peaks(away, scores[np.searchsorted(places, away)], OBSERVED.peaks - 1)
        beside = places[self._near.beside(places, best, OBSERVED.beside)].tolist()
        wanted = dict.fromkeys([*peaks, *beside, *predicted[: OBSERVED.checked]])
        asked = [one for one in wanted if one in places]
        verified = buffer.verified(asked)
        seen = self._ratios(buffer, places, scores, verified, peaks, session_start)
        return self._with(seen, believed)

    @property
    def unseen(self) -> float:
        """The log ratio of places that were not verified: how rarely true ones are not."""
        return max(RATIO.least, 0.5 * math.log(max(self._missed.value, 1e-3)))

    def confirm(self, is_shown: bool) -> None:
        """Take in whether the newest frame alone shows the place that is sure."""
        self._missed.add(not is_shown)

    def learn(self, strength: float) -> None:
        """Take in how strongly a match was verified, of another drive than this."""
        own = math.log(max(strength, 1.0))
        if self._level is None:
            self._level = own
        self._level += (own - self._level) / RATIO.level_memory

    def _ratios(
        self,
        buffer: QueryBuffer,
        places: Indices,
        scores: Values,
        verified: Mapping[int, Verification],
        peaks: Sequence[int],
        session_start: int,
    ) -> Observation:
        log_ratios = np.full(len(places), self.unseen)
        if not verified:
            return Observation(places, np.minimum(log_ratios, 0.0), verified, False)
        looked = np.array(sorted(verified))
        at = np.searchsorted(places, looked)
        roots = 2 * np.sqrt([strength_of(verified[one]) for one in looked.tolist()])
        best = int(looked[roots.argmax()])
        rivals = [one for one in dict.fromkeys(peaks) if not self._near.is_near(one, best)]
        has_rivals = len(self._elsewhere(places, best)) >= OBSERVED.fewest and bool(rivals)
        of_rivals = np.searchsorted(looked, rivals)
        hardest = max(roots[of_rivals], default=2 * math.sqrt(RATIO.unrelated))
        lead = (roots - hardest) / self._strength_scale.value**RATIO.power
        above = scores[at] - max(scores[at][of_rivals], default=float(scores.max()))
        prior = RATIO.prior_score ** (1 - RATIO.power)
        above /= self._score_scale.value**RATIO.power * prior
        leads = Leads(looked, lead, above.clip(-RATIO.most_scales, RATIO.most_scales))
        log_ratios[at] = leads.log_ratios
        for scale, best_few in (
            (self._strength_scale, roots[of_rivals]),
            (self._score_scale, scores[at][of_rivals]),
        ):
            if (gap := gumbel_scale(best_few)) is not None:
                scale.add(gap)
        if not has_rivals:  # then nothing is likelier than elsewhere, but the best is the best
            best_ratio = max(0.0, float(log_ratios.max()))
            log_ratios = np.maximum(log_ratios - best_ratio, RATIO.least)
        log_ratios[at] = self._smoothed(looked, log_ratios[at])
        doubt = self._doubt(buffer, looked, roots, session_start)
        # On its own drive, light and camera are the same, and nothing makes up for a doubt.
        is_own = (looked >= session_start) & (doubt < 0)
        log_ratios[at] = np.where(is_own, np.minimum(log_ratios[at], 0.0), log_ratios[at]) + doubt
        return Observation(places, log_ratios, verified, has_rivals, leads)

    def _with(self, seen: Observation, believed: Indices) -> Observation:
        """Return an observation with more places; beside what is denied, others are, too."""
        places = np.union1d(seen.places, believed)
        looked = np.array(sorted(seen.verified), np.int64)
        log_ratios = np.full(len(places), self.unseen)
        at = np.searchsorted(places, seen.places)
        log_ratios[at] = seen.log_ratios
        if not len(looked):
            return replace(seen, places=places, log_ratios=log_ratios)
        ratios = seen.log_ratios[np.searchsorted(seen.places, looked)]
        best = np.full(len(places), -np.inf)
        for one, ratio in zip(looked.tolist(), ratios, strict=True):
            near = self._near.beside(places, one, LINKS.beside // 2)
            best[near] = np.maximum(best[near], ratio)
        unknown = ~np.isin(places, looked) & np.isfinite(best)
        log_ratios[unknown] = np.minimum(log_ratios[unknown], best[unknown])
        return replace(seen, places=places, log_ratios=log_ratios)

    def _smoothed(self, places: Indices, log_ratios: Values) -> Values:
        """Return ratios of places (n,) that one frame cannot tell from those beside them."""
        found = log_ratios.copy()
        for place, ratio in zip(places.tolist(), log_ratios.tolist(), strict=True):
            near = self._near.beside(places, place, OBSERVED.beside)
            off = RATIO.beside * abs(places[near] - place)
            found[near] = np.maximum(found[near], ratio - off)
        return found

    def _doubt(
        self, buffer: QueryBuffer, places: Indices, roots: Values, session_start: int
    ) -> Values:
        """Return what speaks against places that are shown worse than true ones are."""
        step = buffer.verified_step if places[-1] >= session_start else None
        own = math.log(max(strength_of(step), 1.0)) if step else -math.inf
        other = -math.inf if self._level is None else self._level
        usual = np.where(places >= session_start, own, other)
        share = 2 * np.log(roots / 2) - usual - math.log(RATIO.share)
        return (RATIO.doubt * share).clip(RATIO.least, 0.0)

    def _peaks(self, places: Indices, scores: Values, count: int) -> list[int]:
        """Return the best places by pair score that are not near each other, best first."""
        found, left = list[int](), np.ones(len(places), np.bool_)
        for at in np.argsort(-scores, kind='stable').tolist():
            if left[at]:
                found.append(int(places[at]))
                left &= ~self._near.mask(places, found[-1])
            if len(found) == count:
                break
        return found

    def _elsewhere(self, places: Indices, best: int) -> Indices:
        """Return the places that are controls of the best one."""
        return places[~self._near.mask(places, best)]


def strength_of(shown: Verification) -> float:
    """Return how strongly a place is verified; what lies on the ground alone, hardly counts."""
    return max(min(shown.strength, 3 * shown.upper), RATIO.unrelated / 2)


def _scored(buffer: QueryBuffer, places: Indices) -> tuple[Indices, Values]:
    """Return places that show something, ascending, and their pair scores."""
    buffer.score(1, places)
    row: Row = buffer.rows[0] if buffer.rows[0] is not None else np.zeros(0, np.float32)
    scores = row[places].astype(np.float64)
    known = np.isfinite(scores)
    return places[known], scores[known]
