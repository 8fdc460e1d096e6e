# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What keypoints say of a place, by how far they are expected to lead there, and the light.

Keypoints of a true place lead those of other places: by much in the same light, by little in
another, by nothing in the dark. Brightness on a coarse grid tells the light.
How far they lead is unknown and changes along the way, so it is a state of each place in the
belief. One more state is *a copy*: cells agree, but the place is another one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import math

from convseq_ros.core.decision.budget import BUDGET
from convseq_ros.core.decision.likelihood import COPIES
from convseq_ros.core.encoding.glance import brightness
from convseq_ros.core.map.image_coding import decode_jpeg
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Descriptor, Doubles, Frame, Gray, Indices
from convseq_ros.errors import MapError
import numpy as np


@constants
class KEYPOINTS:
    """
    The lead of a place's keypoints: of twice the root of the blocks that agree.

    `expected`, `by_day`, `sigma`, `floor` and `surprising` were chosen by hand, from the means and
    spreads of leads of right and of wrong places. The rest were chosen by the mean log probability
    that the belief gives to the truth, and by false matches (docs/NOTES.md).
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


@constants
class LIGHT:
    """How light is told by brightness; engineering."""

    frames: int = 10  # memory of the drive's mean: the last seconds (docs/NOTES.md)


class Light:
    """
    The light of one camera's drive, and of the places of its map; without `is_read` it is unknown.

    A place of an earlier drive was seen in the mean light of its session; a place of the running
    drive in the same light as the newest frame.
    """

    def __init__(self, reference_map: ReferenceMap, is_read: bool) -> None:
        self._map, self._is_read = reference_map, is_read
        self._of_sessions = dict[int, Doubles | None]()  # mean brightness (32,), by first place
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._now: Doubles | None = None
        self._frames = 0

    def observe(self, frame: Frame, descriptor: Descriptor) -> None:
        """Take in the brightness of the newest frame."""
        if not self._is_read:
            return
        new = descriptor.brightness
        if new is None and frame.gray is not None:
            new = brightness(frame.gray)
        if new is None:
            return
        if self._now is None or abs(new - self._now).mean() >= KEYPOINTS.dark:
            self._now, self._frames = new, 0  # as where a tunnel begins
        memory = min(self._frames + 1, LIGHT.frames)
        self._now = self._now + (new - self._now) / memory
        self._frames += 1

    def differences(self, places: Indices, earlier: int) -> Doubles:
        """
        Return by how much (n,) the light differs from that of places (n,); infinity if unknown.

        It is the mean difference of logarithms of brightness. Measured: .05 by day, .2 in
        corridor, .3 in the evening, .6 in rain, .9 at night. The first `earlier` places are those
        of earlier drives. Others were seen in the same light: the difference is 0. Brightness
        cannot tell night from shade there, which differs by as much along a walk by day.
        """
        is_earlier = places < earlier
        if self._now is None:
            return np.where(is_earlier, np.inf, 0.0)
        firsts, _ = self._map.bounds.spans(places)
        found = np.zeros(len(places))
        for first in np.unique(np.broadcast_to(firsts, places.shape)[is_earlier]).tolist():
            found[is_earlier & (firsts == first)] = self._difference(first)
        return found

    def _difference(self, first: int) -> float:
        """Return the difference from the session that begins with a place."""
        assert self._now is not None
        then = self._of_session(first)
        return np.inf if then is None else float(abs(self._now - then).mean())

    def _of_session(self, first: int) -> Doubles | None:
        """Return the mean brightness (32,) of an earlier drive, by its first place."""
        if first not in self._of_sessions:
            _, end = self._map.bounds.span(first)
            last = min(end, len(self._map)) - 1
            places = np.unique(np.linspace(first, last, BUDGET.seen).astype(int))
            images = [self._thumbnail(place) for place in places.tolist()]
            known = [brightness(image) for image in images if image is not None]
            self._of_sessions[first] = np.mean(known, axis=0) if known else None
        return self._of_sessions[first]

    def _thumbnail(self, place: int) -> Gray | None:
        """Return the thumbnail (H, W) of a place; None if there is none, or it is damaged."""
        try:
            return decode_jpeg(self._map.thumbnail(place))
        except MapError:  # told where the cells of the place are read
            return None
