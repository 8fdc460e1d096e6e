# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The likelihood ratio of a frame: how many times likelier it is at a place than elsewhere.

Two witnesses speak: cells (pair score and verification) and keypoints. What counts is a place's
*lead* over its strongest rival, a place that shows another scene. `Likelihood.log_ratios` is the
equation.
"""

from collections.abc import Mapping
from dataclasses import dataclass
import math

from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.types import constants, Doubles, Flags
import numpy as np


@constants
class CELLS:
    """
    The density ratio of the cells' leads, its logarithm linear in both; and their scales.

    Chosen by hand between a fit (scripts/fit_observation.py) and no false match, on corridor,
    laps, Gardens Point, drawn streets and aisles (docs/NOTES.md).
    """

    constant: float = -2.0  # without a lead
    strength: float = 0.45  # per scale of the lead in strength
    score: float = 0.45  # per scale of the lead in pair score ...
    most_scales: float = 5.0  # ... up to this many: one similar house can score like a street
    unrelated: float = 30.0  # median strength of unrelated images
    # Scale of the controls' pair scores before a drive has any, and the memory of both scales; the
    # scale of strengths (of twice their square root) starts at 1. The power weakens the scale, as
    # a drive reveals it late.
    prior_score: float = 0.008
    memory: float = 20.0  # frames
    power: float = 0.7
    works: float = 0.86  # probability, at first, that cells show a true place


@constants
class KEYPOINTS:
    """
    The density ratio of the keypoints' lead: of twice the root of the blocks that agree.

    Chosen by hand from the means and spreads of leads that scripts/fit_observation.py prints, on
    the drives of CELLS.
    """

    usual_alike: float = 6.0  # lead of true places at first, in like light ...
    usual_otherwise: float = 2.0  # ... and in other light
    sigma: float = 1.6  # of the leads of true places, and of others about 0
    floor: float = 2.0  # blocks that a rival has at least
    works: float = 0.98  # probability that keypoints show a true place as they usually do
    surprising: float = 3.0  # log ratio of a lead that chance does not give
    memory: float = 10.0  # frames beyond doubt from which the usual lead is learned


@constants
class COPIES:
    """How often another place looks like the true one."""

    all: float = 0.0015  # share of frames elsewhere that look like a place in every respect
    along: float = 0.3  # share of drives elsewhere along which the strongest place moves, too


@constants
class SAME_LIGHT:
    """Places of the running drive: light and camera are the same, and so is the strength."""

    share: float = 0.6  # of the strength of the last two frames; below, a place is doubted ...
    doubt: float = 2.5  # ... by this much per e-fold
    least: float = -2.0


class RecentMean:
    """The mean of recent values, which fade; it starts as a prior value."""

    def __init__(self, prior: float, count: float) -> None:
        self._sum, self._count = prior * count, count

    @property
    def value(self) -> float:
        return self._sum / self._count

    def add(self, value: float) -> None:
        keep = 1 - 1 / CELLS.memory
        self._sum, self._count = keep * self._sum + value, keep * self._count + 1


def gumbel_scale(best: Doubles) -> float | None:
    """
    Return the scale of the Gumbel distribution of the best few of many values, (n,).

    The k-th gap between them is exponential, with a mean of scale / k. None for fewer than three.
    """
    if len(best) < 3:
        return None
    gaps = -np.diff(np.sort(best)[::-1])[:3]
    return float((gaps * np.arange(1, len(gaps) + 1)).mean())


def gain_of(follows: float, chance: float, affirmed: float = 1.0) -> float:
    """
    Return the gain of the strongest place for being the strongest: -log q of `log_ratios`.

    The arguments are those of `Evidence`.
    """
    along = COPIES.along / (COPIES.along + (1 - COPIES.along) * min(1.0, affirmed))
    return -math.log(min(1.0, follows * along + chance))


@dataclass(frozen=True, eq=False, slots=True)
class Leads:
    """The leads of verified places over the strongest rival, in scales."""

    strength: Doubles  # (n,), by place
    score: Doubles  # (n,), by place; at most `CELLS.most_scales`

    @property
    def cells(self) -> Doubles:
        """Logarithms (n,) of the cells' density ratios, linear in both leads."""
        return CELLS.constant + CELLS.strength * self.strength + CELLS.score * self.score


@dataclass(frozen=True, slots=True)
class Asked:
    """A place that keypoints were asked about."""

    lead: float  # over the best of its rivals
    ratio: float  # logarithm of the density ratio of the lead
    is_current: bool  # whether the place is of the running drive


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """What a frame shows of verified places, and how far the belief expected it."""

    cells: Doubles  # (n,), log ratios of `Leads.cells`
    keypoints: Doubles  # (n,), log ratios of `Likelihood.keypoints`; 0 where not asked
    is_strongest: Flags  # (n,), which places lie at the strongest one
    follows: float  # share of the belief's places, in [0, 1], that predicted the strongest one
    chance: float  # that the strongest place of a drive elsewhere lies there, in (0, 1]
    affirmed: float  # ratio by which keypoints affirm the strongest place; 1 if not asked


class Likelihood:
    """Computes likelihood ratios of verified places, with statistics of the drive so far."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self._strength_scale = RecentMean(1.0, CELLS.memory / 2)
        self._score_scale = RecentMean(CELLS.prior_score, CELLS.memory / 2)
        self._missed = RecentMean(1 - CELLS.works, CELLS.memory / 2)
        self._usual: dict[bool, float] = {}  # learned lead of true places, by `is_current`

    @property
    def cells_work(self) -> float:
        """The probability that cells show a true place on this drive."""
        return 1 - max(self._missed.value, 0.02)

    @property
    def unverified(self) -> float:
        """The log ratio of places that were not verified."""
        return math.log(1 - self.cells_work)

    def log_ratios(self, evidence: Evidence) -> Doubles:
        """
        Return the logarithms (n,) of the likelihood ratios of verified places.

        With the density ratio e^c of the cells, that of the keypoints, e^k, and the probabilities
        r and s that cells and keypoints work here, the ratio is

            R = (r e^c / q + 1 - r) (s e^k + 1 - s),  divided by  1 + a max R  down to 1

        q is the chance that the strongest place of the map lies where it lies, if the drive is
        elsewhere: 17 in N, or more if the belief followed it, since the strongest place moves
        along in a share of copies; for all other places q is 1. a is the share of frames elsewhere
        that look like the best place in every respect, so no frame decides alone.
        """
        works, gain = (
            self.cells_work,
            gain_of(evidence.follows, evidence.chance, evidence.affirmed),
        )
        spoken = math.log(works) + evidence.cells + gain * evidence.is_strongest
        total = np.logaddexp(spoken, math.log(1 - works)) + evidence.keypoints
        bound = np.logaddexp(0.0, total.max() + math.log(COPIES.all))
        return np.asarray(np.minimum(total, np.maximum(total - bound, 0.0)))

    def leads(self, strengths: Doubles, scores: Doubles, is_rival: Flags) -> Leads:
        """
        Return the leads of verified places (n,) over the best of the rivals among them.

        Updates the scales with the gaps between the rivals.
        """
        roots = 2 * np.sqrt(strengths)
        hardest = roots[is_rival].max(initial=0.0) or 2 * math.sqrt(CELLS.unrelated)
        lead = (roots - hardest) / self._strength_scale.value**CELLS.power
        above = scores - (scores[is_rival].max() if is_rival.any() else scores.max())
        prior = CELLS.prior_score ** (1 - CELLS.power)
        above /= self._score_scale.value**CELLS.power * prior
        for scale, best in ((self._strength_scale, roots), (self._score_scale, scores)):
            if (gap := gumbel_scale(best[is_rival])) is not None:
                scale.add(gap)
        return Leads(lead, above.clip(-CELLS.most_scales, CELLS.most_scales))

    def asked(
        self, blocks: Mapping[int, int], current: Mapping[int, bool], is_alike: bool
    ) -> dict[int, Asked]:
        """
        Return the answers of the keypoints about places, from their agreeing blocks.

        Leads are normal, with the mean u at true places and 0 elsewhere, so the log ratio of a
        lead x is u (x - u / 2) / sigma^2: where keypoints do not repeat, u is 0 and they are
        silent. Places that both lead over chance show the same scene: neither is a rival.
        """
        roots = {place: 2 * math.sqrt(count) for place, count in blocks.items()}
        least = 2 * math.sqrt(KEYPOINTS.floor)

        def ratio(place: int, lead: float) -> float:
            usual = self._usual_lead(current[place], is_alike)
            return usual * (lead - usual / 2) / KEYPOINTS.sigma**2

        scenes = {p for p, root in roots.items() if ratio(p, root - least) > KEYPOINTS.surprising}
        answers = {}
        for place, root in roots.items():
            shown = scenes if place in scenes else {place}
            rivals = [roots[other] for other in roots if other not in shown]
            lead = root - max([least, *rivals])
            answers[place] = Asked(lead, ratio(place, lead), current[place])
        return answers

    def keypoints(self, answer: Asked) -> float:
        """Return the log ratio of a place by keypoints; they may fail to show a true place."""
        works = KEYPOINTS.works
        return float(np.logaddexp(math.log(works) + answer.ratio, math.log(1 - works)))

    def learn(self, answer: Asked, cells: float, is_alike: bool) -> None:
        """
        Take in what keypoints said of the strongest place, if cells leave no doubt of it.

        `cells` is its log ratio by cells. Copies are not that strong, so they teach nothing.
        """
        if cells > KEYPOINTS.surprising:
            usual = self._usual_lead(answer.is_current, is_alike)
            learned = max(0.0, usual + (answer.lead - usual) / KEYPOINTS.memory)
            self._usual[answer.is_current] = learned

    def _usual_lead(self, is_current: bool, is_alike: bool) -> float:
        is_like = is_current or is_alike
        start = KEYPOINTS.usual_alike if is_like else KEYPOINTS.usual_otherwise
        return self._usual.get(is_current, start)

    def confirm(self, is_shown: bool) -> None:
        """Take in a match: whether the newest frame alone speaks for it."""
        self._missed.add(not is_shown)


def doubts(strengths: Doubles, is_current: Flags, step: Verification | None) -> Doubles:
    """
    Return log ratios (n,), at most 0, against weak places of the running drive.

    `step` is the verification of the last two frames of the drive, in the same light.
    """
    if step is None:
        return np.zeros(len(strengths))
    share = np.log(strengths) - math.log(strength_of(step)) - math.log(SAME_LIGHT.share)
    doubted = (SAME_LIGHT.doubt * share).clip(SAME_LIGHT.least, 0.0)
    return np.where(is_current, doubted, 0.0)


def strength_of(result: Verification) -> float:
    """Return the strength of a verification, at most 3 times that of the image's upper half."""
    return max(min(result.strength, 3 * result.upper), CELLS.unrelated / 2)
