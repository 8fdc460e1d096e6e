# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The likelihood: how many times likelier what a frame shows is at a place than elsewhere.

What counts is by how much a place leads the best control, a place that is none of its looks, in
pair score and in verification score. Both leads are divided by the mean gap between the controls:
the best of many that are no match scatter as a Gumbel distribution does, so the gaps between them
are exponential, and their mean is its scale. So a lead says the same in a forest and in a corridor
of identical lockers. Once a drive has matches, the verification score that these usually have
counts as well.
"""

from dataclasses import dataclass
import math

from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.types import constants, Doubles, Flags
import numpy as np


@constants
class RATIO:
    """
    Of the log of the likelihood ratio.

    Chosen with corridor, laps and Gardens Point in view. scripts/fit_observation.py prints a
    logistic regression beside them; it was not fitted anew since rough scores came.
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
    # Scale of the gaps between controls' pair scores, before a drive has shown any, and how many
    # frames it counts for; that of strengths, in square roots, doubled, is 1. The power takes back
    # part of what a drive shows, as it shows it late.
    prior_score: float = 0.008
    memory: float = 20.0  # frames
    power: float = 0.7
    # A place that is shown far worse than true ones are on this drive is not true: the log of the
    # share of the usual strength, times this, below ...
    doubt: float = 2.5
    share: float = 0.6  # this share. On its own drive, usual is what the frame before has.
    # From this share of what matches of this drive usually have, a place is another hypothesis and
    # no control; and a control denies a place no further than its own share does.
    alike: float = 0.75
    level_memory: float = 5.0  # matches over which the usual strength is averaged


@dataclass(frozen=True, eq=False, slots=True)
class Leads:
    """By how much verified places lead their hardest control, in scales."""

    strength: Doubles  # (n,), by places
    score: Doubles  # (n,), of a bounded number of scales

    @property
    def log_ratios(self) -> Doubles:
        """The log ratios (n,), linear in both leads."""
        ratios = RATIO.constant + RATIO.strength * self.strength + RATIO.score * self.score
        return ratios.clip(RATIO.least, RATIO.most)


class RecentMean:
    """The mean of the last values or so, and at first of what was usual before."""

    def __init__(self, usual: float, count: float) -> None:
        self._sum, self._count = usual * count, count

    @property
    def value(self) -> float:
        return self._sum / self._count

    def add(self, value: float) -> None:
        keep = 1 - 1 / RATIO.memory
        self._sum, self._count = keep * self._sum + value, keep * self._count + 1


def gumbel_scale(best: Doubles) -> float | None:
    """
    Return the scale of what scatters as the best of many do, given the best few (n,).

    The k-th gap between them is exponential, with the k-th part of the scale as its mean. None of
    fewer than three.
    """
    if len(best) < 3:
        return None
    gaps = -np.diff(np.sort(best)[::-1])[:3]
    return float((gaps * np.arange(1, len(gaps) + 1)).mean())


class Likelihood:
    """Judges verified places, by what this drive has shown so far."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self._strength_scale = RecentMean(1.0, RATIO.memory / 2)
        self._score_scale = RecentMean(RATIO.prior_score, RATIO.memory / 2)
        # What matches usually have, as a logarithm: places of other drives, and of this one.
        self._usual: dict[bool, float] = {}
        self._missed = RecentMean(0.5, 1.0)  # share of frames that do not show their place

    @property
    def unseen(self) -> float:
        """The log ratio of places that were not verified: how rarely true ones are not."""
        return max(RATIO.least, 0.5 * math.log(max(self._missed.value, 1e-3)))

    def confirm(self, is_shown: bool) -> None:
        """Take in whether the newest frame alone shows the place that is sure."""
        self._missed.add(not is_shown)

    def learn(self, strength: float, is_own: bool) -> None:
        """Take in how strongly a match was verified, of a place of this drive or of another."""
        new = math.log(strength)
        usual = self._usual.setdefault(is_own, new)
        self._usual[is_own] += (new - usual) / RATIO.level_memory

    def hypotheses(self, strengths: Doubles, is_own: Flags) -> Flags:
        """Return which places (n,) are shown as strongly as matches of this drive are."""
        return self._shares(strengths, is_own) > math.log(RATIO.alike)

    def judge(self, strengths: Doubles, scores: Doubles, is_rival: Flags) -> Leads:
        """
        Return by how much verified places (n,) lead the hardest of the controls among them.

        Learns how far the controls are apart.
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

    def support(self, strengths: Doubles, is_own: Flags) -> Doubles:
        """Return how far a control may deny places (n,): not as strong ones as matches have."""
        return (RATIO.doubt * self._shares(strengths, is_own)).clip(RATIO.least, 0.0)

    def doubts(self, strengths: Doubles, is_own: Flags, step: Verification | None) -> Doubles:
        """
        Return what speaks against places (n,) that are shown worse than true ones are.

        Places of this drive are compared with the `step` from the frame before.
        """
        known = math.log(strength_of(step)) if step else -math.inf
        usual = np.where(is_own, known, self._usual.get(False, -math.inf))
        share = np.log(strengths) - usual - math.log(RATIO.share)
        return (RATIO.doubt * share).clip(RATIO.least, 0.0)

    def _shares(self, strengths: Doubles, is_own: Flags) -> Doubles:
        """Return logarithms of shares (n,) of what matches usually have; -inf if none is known."""
        own, other = (self._usual.get(kind, math.inf) for kind in (True, False))
        return np.log(strengths) - np.where(is_own, own, other)


def strength_of(shown: Verification) -> float:
    """Return how strongly a place is verified; what lies on the ground alone, hardly counts."""
    return max(min(shown.strength, 3 * shown.upper), RATIO.unrelated / 2)
