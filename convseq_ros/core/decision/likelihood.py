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

    Chosen on corridor, laps and Gardens Point. scripts/fit_observation.py prints and draws a fit.
    """

    constant: float = -0.7  # without a lead
    strength: float = 0.4  # per scale of the lead in strength
    score: float = 0.5  # per scale of the lead in pair score ...
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
    The density ratio of the keypoints' lead: the roots of twice the blocks, so 1 is its sigma.

    Chosen on laps, corridor, RTAB-Map and drawn streets, by day and night.
    """

    slope: float = 1.1  # of the log ratio
    neutral: float = 2.6  # lead without information
    floor: float = 7.0  # blocks that a rival has at least: by chance, 95 % have fewer
    hypothesis: float = 0.5  # of the usual blocks: a rival with more is another hypothesis
    # Probability, at first, that keypoints repeat, by like and by other light. It is learned: a
    # lead that chance does not give raises it. Nothing lowers it, so false matches do not teach.
    works_alike: float = 0.95
    works_otherwise: float = 0.2
    most: float = 0.995
    surprising: float = 3.0  # log ratio of a lead that chance does not give
    memory: float = 10.0  # such leads


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

    root: float  # twice the root of the blocks that agree
    ratio: float  # logarithm of the density ratio of its lead
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
        self._repeats: dict[bool, float] = {}  # learned probability, by `is_current`
        self._usual: dict[bool, float] = {}  # roots of matches, by `is_current`

    @property
    def cells_work(self) -> float:
        """The probability that cells show a true place on this drive."""
        return 1 - max(self._missed.value, 0.02)

    @property
    def unverified(self) -> float:
        """The log ratio of places that were not verified."""
        return math.log(1 - self.cells_work)

    def log_ratios(self, seen: Evidence) -> Doubles:
        """
        Return the logarithms (n,) of the likelihood ratios of verified places.

        With the density ratio e^c of the cells, that of the keypoints, e^k, and the probabilities
        r and s that cells and keypoints work here, the ratio is

            R = (r e^c / q + 1 - r) (s e^k + 1 - s),  bounded by  R / (1 + a R)

        q is the chance that the strongest place of the map lies where it lies, if the drive is
        elsewhere: 1 in N, or more if the belief followed it, since the strongest place moves along
        in a share of copies; for all other places q is 1. a is the share of frames elsewhere that
        look like a place in every respect, so no frame decides alone.
        """
        along = COPIES.along / (COPIES.along + (1 - COPIES.along) * min(1.0, seen.affirmed))
        chance = min(1.0, seen.follows * along + seen.chance)
        works, gain = self.cells_work, -math.log(chance) * seen.is_strongest
        spoken = math.log(works) + seen.cells + gain
        total = np.logaddexp(spoken, math.log(1 - works)) + seen.keypoints
        return np.asarray(-np.logaddexp(-total, math.log(COPIES.all)))

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

    def asked(self, blocks: Mapping[int, int], current: Mapping[int, bool]) -> dict[int, Asked]:
        """Return the answers of the keypoints about places, from their agreeing blocks."""
        roots = {place: 2 * math.sqrt(count) for place, count in blocks.items()}

        def is_hypothesis(place: int) -> bool:
            usual = self._usual.get(current[place], math.inf)
            return roots[place] ** 2 > KEYPOINTS.hypothesis * usual**2

        answers = {}
        for place, root in roots.items():
            rivals = [
                roots[other]
                for other in roots
                if other != place and not (is_hypothesis(place) and is_hypothesis(other))
            ]
            lead = root - max([2 * math.sqrt(KEYPOINTS.floor), *rivals])
            ratio = KEYPOINTS.slope * (lead - KEYPOINTS.neutral)
            answers[place] = Asked(root, ratio, current[place])
        return answers

    def keypoints(self, answer: Asked, is_alike: bool) -> float:
        """Return the log ratio of a place by keypoints: silent as far as they do not repeat."""
        works = self._works(answer.is_current, is_alike)
        return float(np.logaddexp(math.log(works) + answer.ratio, math.log(1 - works)))

    def _works(self, is_current: bool, is_alike: bool) -> float:
        start = KEYPOINTS.works_alike if is_current or is_alike else KEYPOINTS.works_otherwise
        return max(start, self._repeats.get(is_current, 0.0))

    def learn_repeats(self, answers: Mapping[int, Asked], is_alike: bool) -> None:
        """Take in what keypoints said: a lead that chance does not give shows that they repeat."""
        best = max(answers.values(), key=lambda answer: answer.ratio, default=None)
        if best and best.ratio > KEYPOINTS.surprising:
            works = self._works(best.is_current, is_alike)
            raised = works + (1 - works) / KEYPOINTS.memory
            self._repeats[best.is_current] = min(KEYPOINTS.most, raised)

    def confirm(self, is_shown: bool, answer: Asked | None) -> None:
        """Take in a match: whether the newest frame alone speaks for it, and its keypoints."""
        self._missed.add(not is_shown)
        if answer:
            usual = self._usual.setdefault(answer.is_current, answer.root)
            self._usual[answer.is_current] += (answer.root - usual) / KEYPOINTS.memory


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
