# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The likelihood ratio of a frame: how many times likelier it is at a place than elsewhere.

It depends on two leads of a place over the best control, a place that is not near it: in pair
score and in verification score (strength). Both leads are divided by the scale of the controls:
the best of many wrong places follow a Gumbel distribution, the gaps between them are exponential,
and the mean gap is the scale. So a lead means the same in a forest and in a corridor of identical
lockers. After the first match of a drive, a place is also compared with the usual strength of
its matches.
"""

from dataclasses import dataclass
import math

from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.types import constants, Doubles, Flags
import numpy as np


@constants
class RATIO:
    """
    Coefficients of the logarithm of the likelihood ratio.

    Chosen by hand on corridor, laps and Gardens Point. scripts/fit_observation.py prints a
    logistic regression for comparison; it was not repeated after rough scores were introduced.
    """

    constant: float = -0.7  # without a lead
    strength: float = 0.4  # per scale of the lead in strength
    score: float = 0.5  # per scale of the lead in pair score ...
    most_scales: float = 5.0  # ... up to this many: one similar house can score like a street
    unrelated: float = 30.0  # median strength of unrelated images
    # Loss per place of distance from a place that leads, for the places beside it.
    beside: float = 0.25
    least: float = -2.0
    most: float = 6.5
    # Scale of the controls' pair scores before a drive has any, and the memory of both scales; the
    # scale of strengths (of twice their square root) starts at 1. The power weakens the scale, as
    # a drive reveals it late.
    prior_score: float = 0.008
    memory: float = 20.0  # frames
    power: float = 0.7
    # A place with far less strength than matches of the drive have is wrong. The log ratio loses
    # `doubt` times the logarithm of its share of the usual strength, if that is below `share`.
    doubt: float = 2.5
    share: float = 0.6  # For places of the running drive, usual is that of the last two frames.
    # From this share of the usual strength on, a place is a rival hypothesis and not a control;
    # and a control lowers the ratio of a place only as far as the place's own share allows.
    rival: float = 0.75
    level_memory: float = 5.0  # number of matches over which the usual strength is averaged


@dataclass(frozen=True, eq=False, slots=True)
class Leads:
    """The leads of verified places over the best control, in scales."""

    strength: Doubles  # (n,), by place
    score: Doubles  # (n,), by place; at most `RATIO.most_scales`

    @property
    def log_ratios(self) -> Doubles:
        """The log ratios (n,), linear in both leads."""
        ratios = RATIO.constant + RATIO.strength * self.strength + RATIO.score * self.score
        return ratios.clip(RATIO.least, RATIO.most)


class RecentMean:
    """The mean of recent values, which fade; it starts as a prior value."""

    def __init__(self, prior: float, count: float) -> None:
        self._sum, self._count = prior * count, count

    @property
    def value(self) -> float:
        return self._sum / self._count

    def add(self, value: float) -> None:
        keep = 1 - 1 / RATIO.memory
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


class Likelihood:
    """Computes likelihood ratios of verified places, with statistics of the drive so far."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self._strength_scale = RecentMean(1.0, RATIO.memory / 2)
        self._score_scale = RecentMean(RATIO.prior_score, RATIO.memory / 2)
        # Logarithm of the usual strength of matches, by `is_current`.
        self._usual: dict[bool, float] = {}
        self._missed = RecentMean(0.5, 1.0)  # share of frames that alone do not show their place

    @property
    def unseen(self) -> float:
        """The log ratio of places that were not verified: low if true ones usually are."""
        return max(RATIO.least, 0.5 * math.log(max(self._missed.value, 1e-3)))

    def confirm(self, is_shown: bool) -> None:
        """Take in whether the newest frame alone speaks for the matched place."""
        self._missed.add(not is_shown)

    def learn(self, strength: float, is_current: bool) -> None:
        """Take in the strength of a match; `is_current`: its place is of the running drive."""
        new = math.log(strength)
        usual = self._usual.setdefault(is_current, new)
        self._usual[is_current] += (new - usual) / RATIO.level_memory

    def hypotheses(self, strengths: Doubles, is_current: Flags) -> Flags:
        """Return which places (n,) have nearly the usual strength of matches."""
        return self._shares(strengths, is_current) > math.log(RATIO.rival)

    def judge(self, strengths: Doubles, scores: Doubles, is_rival: Flags) -> Leads:
        """
        Return the leads of verified places (n,) over the best of the rivals among them.

        Updates the scales with the gaps between the rivals.
        """
        roots = 2 * np.sqrt(strengths)
        hardest = roots[is_rival].max(initial=0.0) or 2 * math.sqrt(RATIO.unrelated)
        lead = (roots - hardest) / self._strength_scale.value**RATIO.power
        above = scores - (scores[is_rival].max() if is_rival.any() else scores.max())
        prior = RATIO.prior_score ** (1 - RATIO.power)
        above /= self._score_scale.value**RATIO.power * prior
        for scale, best in ((self._strength_scale, roots), (self._score_scale, scores)):
            if (gap := gumbel_scale(best[is_rival])) is not None:
                scale.add(gap)
        return Leads(lead, above.clip(-RATIO.most_scales, RATIO.most_scales))

    def support(self, strengths: Doubles, is_current: Flags) -> Doubles:
        """Return lower bounds (n,) of the log ratios: 0 for a place as strong as a match."""
        return (RATIO.doubt * self._shares(strengths, is_current)).clip(RATIO.least, 0.0)

    def doubts(self, strengths: Doubles, is_current: Flags, step: Verification | None) -> Doubles:
        """
        Return log ratios (n,), at most 0, against places with less strength than usual.

        Places of the running drive are compared with `step`, the verification of the last two
        frames.
        """
        known = math.log(strength_of(step)) if step else -math.inf
        usual = np.where(is_current, known, self._usual.get(False, -math.inf))
        share = np.log(strengths) - usual - math.log(RATIO.share)
        return (RATIO.doubt * share).clip(RATIO.least, 0.0)

    def _shares(self, strengths: Doubles, is_current: Flags) -> Doubles:
        """Return logarithms (n,) of shares of the usual strength; -inf if it is not known."""
        own, other = (self._usual.get(kind, math.inf) for kind in (True, False))
        return np.log(strengths) - np.where(is_current, own, other)


def strength_of(result: Verification) -> float:
    """Return the strength of a verification, at most 3 times that of the image's upper half."""
    return max(min(result.strength, 3 * result.upper), RATIO.unrelated / 2)
