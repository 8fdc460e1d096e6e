# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The likelihood ratio of a frame: how many times likelier it is at a place than elsewhere.

Two witnesses, cells and keypoints, tell by the *lead* of a place over its strongest rival, a place
that shows another scene. The ratio of a place is

    R = C K
    C = r e^c / q + 1 - r,                    divided by  1 + a max C,  down to 1
    K = sum of P(u) L(u, x),                  divided by  1 - b + b K
    c = k + p (x1 + x2)
    q = min(1, f o / (o + (1 - o) min(1, K)) + h / N)

- c is the log density ratio of the cells (`Leads.cells`), of x1, the lead in twice the root of the
  verification score, over its scale, and x2, that in pair score, over its scale: of rivals, what
  is left without their share of the scene (`Likelihood.leads`). k and p are `CELLS.constant` and
  `per_scale`.
- r is the probability that cells show a true place, `CELLS.works`.
- q is the chance that the strongest place lies where it lies, if the drive is elsewhere
  (`gain_of`); for places that are not at it, q is 1. f is what the belief expected there, o
  `COPIES.along`, h `COPIES.by_chance`, N how many places may be matched; K is not divided there.
- P(u) is the probability of the place's state, its expected lead u or *a copy*, and L the ratio of
  the densities of the keypoints' lead x (`expected_lead.ratios_of`).
- a and b are the shares of frames elsewhere that look the same, `COPIES.cells`, so that cells
  decide in no single frame, and `COPIES.scenes`, so that keypoints decide in one or two.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math

from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.types import constants, Doubles, Flags, Indices
import numpy as np


@constants
class CELLS:
    """
    The density ratio of the cells' leads, its logarithm linear in both; and their scales.

    Chosen by hand between a fit and no false match, on corridor, laps, Gardens Point, drawn
    streets and aisles (docs/NOTES.md).
    """

    constant: float = -2.0  # without a lead
    per_scale: float = 0.5  # of the lead in strength, and of that in pair score ...
    most_scales: float = 5.0  # ... up to this many: one similar house can score like a street
    works: float = 0.9  # probability that cells show a true place
    loss_per_place: float = 0.25  # log ratio, by the distance from a place that leads
    # Scale of the controls' pair scores before a drive has any, and the memory of both scales; the
    # scale of strengths (of twice their square root) starts at 1.
    prior_score: float = 0.008
    memory: float = 20.0  # frames


@constants
class COPIES:
    """How often another place looks like the true one."""

    # Shares of frames elsewhere that look like a place: by cells in every respect, which is also
    # the share of what enters that is at a copy, and bounds what of the lost enters a place; by
    # keypoints that agree as a scene.
    cells: float = 5e-4  # chosen by fit_decision.py, with each place left out in turn
    scenes: float = 1e-4
    along: float = 0.3  # share of drives elsewhere along which the strongest place moves, too
    by_chance: float = 9.0  # places in which the strongest one lies by chance (docs/NOTES.md)


def unverified() -> float:
    """Return the log ratio of places that are not verified; it is the least that cells leave."""
    return math.log(1 - CELLS.works)


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
    Return the gain of the strongest place for being the strongest: -log q.

    `follows` is f of the equation, `chance` h / N, and `affirmed` the sum K of its keypoints.
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
        return CELLS.constant + CELLS.per_scale * self.strength + CELLS.per_scale * self.score


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """What a frame shows of verified places, and how far the belief expected it."""

    cells: Doubles  # (n,), log ratios of `Leads.cells`
    keypoints: Doubles  # (n,), k: log ratios; 0 where not asked
    distances: Doubles  # (n, n), in places; inf if one says nothing of the other
    is_strongest: Flags  # (n,), which places lie at the strongest one
    follows: float  # probability of the strongest place before the frame, if the robot is mapped
    chance: float  # that the strongest place of a drive elsewhere lies there, in (0, 1]
    affirmed: float  # ratio by which keypoints affirm the strongest place; 1 if not asked
    weight: float  # of what speaks for a place, in [0, 1]; 0 without enough rivals


class Likelihood:
    """Computes likelihood ratios of verified places, with statistics of the drive so far."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self._strength_scale = RecentMean(1.0, CELLS.memory / 2)
        self._score_scale = RecentMean(CELLS.prior_score, CELLS.memory / 2)

    def log_ratios(self, evidence: Evidence) -> Doubles:
        """
        Return the logarithms (n,) of the likelihood ratios R of verified places.

        A frame hardly tells a place from its neighbours, so a place has at least the logarithm of
        one beside it, less a loss per place. A positive logarithm is multiplied by the weight.
        """
        gain = gain_of(evidence.follows, evidence.chance, evidence.affirmed)
        spoken = math.log(CELLS.works) + evidence.cells + gain * evidence.is_strongest
        cells, keypoints = np.logaddexp(spoken, unverified()), evidence.keypoints
        bound = np.logaddexp(0.0, cells.max() + math.log(COPIES.cells))
        total = np.minimum(cells, np.maximum(cells - bound, 0.0))
        copies, others = math.log(COPIES.scenes), math.log(1 - COPIES.scenes)
        total += keypoints - np.logaddexp(others, keypoints + copies)
        shared = (total[:, None] - CELLS.loss_per_place * evidence.distances).max(axis=0)
        return np.asarray(np.where(shared > 0, evidence.weight * shared, shared))

    def leads(
        self,
        strengths: Doubles,
        scores: Doubles,
        is_rival: Flags,
        share: Callable[[int], float] = lambda _: 0.0,
    ) -> Leads:
        """
        Return the leads of verified places (n,) over the best of the rivals among them.

        If the strongest place is the true one, a rival that shows the share s of its scene, which
        `share` returns by position, has s of its strength, and s of what its own pair score is
        above the lowest of the rivals'. The rest is what speaks against the strongest place.
        Without a rival, strengths lead over 0, and pair scores over the highest of all.
        """
        rivals, strongest = np.flatnonzero(is_rival), strengths.max(initial=0.0)
        lowest = scores[rivals].min(initial=math.inf)

        def strength_left(at: int) -> float:
            return max(0.0, float(strengths[at] - share(at) * strongest))

        def score_left(at: int) -> float:
            return float(scores[at] - share(at) * (scores[at] - lowest))

        hardest = 2 * math.sqrt(_largest_rest(strengths, rivals, strength_left, 0.0))
        ahead = _largest_rest(scores, rivals, score_left, -math.inf)
        lead = (2 * np.sqrt(strengths) - hardest) / self._strength_scale.value
        beats = (scores - (ahead if len(rivals) else scores.max())) / self._score_scale.value
        return Leads(lead, beats.clip(-CELLS.most_scales, CELLS.most_scales))

    def learn(self, strengths: Doubles, scores: Doubles, is_rival: Flags) -> None:
        """Update the scales by the gaps between the rivals among verified places (n,)."""
        roots = 2 * np.sqrt(strengths)
        for scale, best in ((self._strength_scale, roots), (self._score_scale, scores)):
            if (gap := gumbel_scale(best[is_rival])) is not None:
                scale.add(gap)


def _largest_rest(
    values: Doubles, positions: Indices, rest: Callable[[int], float], least: float
) -> float:
    """Return the largest rest of values (n,) at positions, at least `least`; a rest is smaller."""
    for at in positions[np.argsort(-values[positions], kind='stable')].tolist():
        if values[at] <= least:
            break
        least = max(least, rest(at))
    return least


def strength_of(result: Verification) -> float:
    """Return the strength of a verification, at most 3 times that of the image's upper half."""
    return min(result.strength, 3 * result.upper)
