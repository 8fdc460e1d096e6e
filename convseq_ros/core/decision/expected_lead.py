# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What keypoints say of a place, by how far they are expected to lead there.

Keypoints of a true place lead those of other places: by much in the same light, by little in
another, by nothing in the dark.
How far they lead is unknown and changes along the way, so it is a state of each place in the
belief. One more state is *a copy*: cells agree, but the place is another one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import math

from convseq_ros.core.decision.likelihood import COPIES
from convseq_ros.core.types import constants, Doubles, Indices
import numpy as np


@constants
class KEYPOINTS:
    """
    The lead of a place's keypoints: of twice the root of the blocks that agree.

    `expected`, `by_day`, `sigma`, `floor` and `surprising` were chosen by hand, from the means and
    spreads of leads that scripts/fit_observation.py prints. The rest were chosen by the mean log
    probability that the belief gives to the truth, and by false matches (docs/NOTES.md).
    """

    expected: tuple[float, ...] = (0.0, 2.0, 4.0, 6.0, 8.0)  # leads that a place may have
    by_day: float = 6.0  # the likeliest of them at first, if drive and map have the same light ...
    dark: float = 0.45  # ... and it falls to 0 at this difference of the light
    spread: float = 0.8  # difference from the likeliest over which the probability falls by e
    # Share of the mass of a place that takes its expected lead anew, per keyframe; also the weight
    # of the last match in what is learned of the drive.
    changing: float = 0.1
    sigma: float = 1.23  # of the leads of true places about the expected one
    others: float = 1.6  # sigma of those of other places about 0; chosen by fit_decision.py
    floor: float = 2.0  # blocks that a rival has at least
    surprising: float = 3.0  # log ratio of a lead that chance does not give


STATES = len(KEYPOINTS.expected) + 1  # of a place in the belief; the last is a copy


@dataclass(frozen=True, slots=True)
class KeypointRatio:
    """A place that keypoints were asked about."""

    lead: float  # over the best of its rivals
    ratio: float  # logarithm of the likelihood ratio


class ExpectedLead:
    """
    How probable each expected lead is where a drive enters the map, by its light and its matches.

    `differences` returns by how much the light differs from that of places (n,), of which the
    first `earlier` are those of earlier drives. What matches teach are factors of what the light
    lets expect, apart for places of earlier drives and for those of the running drive.
    """

    def __init__(self, differences: Callable[[Indices, int], Doubles]) -> None:
        self._differences = differences
        self.reset()

    def reset(self) -> None:
        """Forget what matches of the drive have taught."""
        # For places of earlier drives, and of the running one.
        self._factors = np.ones((2, len(KEYPOINTS.expected)))

    def probabilities(self, places: Indices, earlier: int) -> Doubles:
        """Return the probabilities (5, n) of the expected leads at places (n,)."""
        first = _at_first(self._differences(places, earlier))
        learned = first * self._factors[(places >= earlier).astype(int)].T
        return np.asarray(learned / learned.sum(axis=0))

    def entering(self, places: Indices, earlier: int) -> Doubles:
        """Return the shares (6, n) of the states of mass that enters places (n,); sums are 1."""
        true = (1 - COPIES.cells) * self.probabilities(places, earlier)
        return np.vstack((true, np.full(len(places), COPIES.cells)))

    def moved(self, states: Doubles, places: Indices, earlier: int, ending: float) -> Doubles:
        """
        Return the mass (6, n) of the states of places (n,) after a step.

        A share takes an expected lead anew. Of copies, the share `ending` is then elsewhere.
        """
        true, changing = states[:-1], KEYPOINTS.changing
        anew = changing * self.probabilities(places, earlier) * true.sum(axis=0)
        return np.vstack(((1 - changing) * true + anew, (1 - ending) * states[-1]))

    def learn(self, states: Doubles, place: int, earlier: int) -> None:
        """
        Take in the mass (5,) of the expected leads at a place that is a match.

        None becomes less probable than the least probable in like light. Of the running drive,
        silence, an expected lead of 0, does not become more probable than the light lets expect:
        its light is the same, and a copy is silent, too.
        """
        at = np.array([place])
        first = _at_first(self._differences(at, earlier))[:, 0]
        known = self.probabilities(at, earlier)[:, 0]
        learned = known + KEYPOINTS.changing * (states / states.sum() - known)
        if place >= earlier:
            learned[0] = min(learned[0], first[0])
        least = _at_first(np.zeros(1)).min()
        self._factors[int(place >= earlier)] = np.maximum(learned, least) / first


def ratios_of(lead: float) -> Doubles:
    """
    Return the likelihood ratios (6,) of a lead, by state.

    Leads are normal: about the expected lead u with `sigma` at true places, and about 0 with
    `others` at other ones. A true place that expects none, u = 0, and a copy are like others: 1.
    """
    expected = np.array((*KEYPOINTS.expected, 0.0))
    true, other = (lead - expected) / KEYPOINTS.sigma, lead / KEYPOINTS.others
    ratios = KEYPOINTS.others / KEYPOINTS.sigma * np.exp((other**2 - true**2) / 2)
    return np.where(expected > 0, ratios, 1.0)


def keypoint_ratios(
    blocks: Mapping[int, int], states: Mapping[int, Doubles], is_near: Callable[[int, int], bool]
) -> dict[int, KeypointRatio]:
    """
    Return what keypoints say of places, from their agreeing blocks and the states' shares (6,).

    Places that are near each other, and places that both lead over chance, show the same scene:
    neither is a rival.
    """
    roots = {place: 2 * math.sqrt(count) for place, count in blocks.items()}
    least = 2 * math.sqrt(KEYPOINTS.floor)

    def answer(place: int, lead: float) -> KeypointRatio:
        return KeypointRatio(lead, math.log(states[place] @ ratios_of(lead)))

    scenes = {p for p in roots if answer(p, roots[p] - least).ratio > KEYPOINTS.surprising}
    answered = {}
    for place, root in roots.items():
        shown = scenes if place in scenes else {place}
        rivals = [roots[p] for p in roots if p not in shown and not is_near(p, place)]
        answered[place] = answer(place, root - max([least, *rivals]))
    return answered


def _at_first(differences: Doubles) -> Doubles:
    """Return the probabilities (5, n) of the expected leads by light, before a drive shows any."""
    likeliest = KEYPOINTS.by_day * np.maximum(0.0, 1 - differences / KEYPOINTS.dark)
    falls = np.exp(-abs(np.array(KEYPOINTS.expected)[:, None] - likeliest) / KEYPOINTS.spread)
    return np.asarray(falls / falls.sum(axis=0))
