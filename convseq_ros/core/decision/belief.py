# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The belief: a discrete Bayes filter over places, velocities, expected leads and *elsewhere*.

Each keyframe is one step: `predict` moves the mass as the robot may have moved, and `update`
multiplies it by the likelihood ratios of the frame. Only places that hold mass are kept, so the
time of a step depends on their number, not on the size of the map.

Sources: Hansen and Browning 2014 (SeqSLAM as a hidden Markov model); Xu, Suenderhauf and Milford
2020 (an off-map state).
"""

from collections.abc import Callable
import math

from convseq_ros.core.decision.budget import BUDGET
from convseq_ros.core.decision.expected_lead import ExpectedLead, STATES
from convseq_ros.core.decision.likelihood import COPIES
from convseq_ros.core.decision.motion import MOTION, MotionModel
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Doubles, Flags, Indices
import numpy as np

Shown = tuple[Indices, Doubles]  # places (n,), ascending, and the shares of a scene that they show
_NOWHERE: Shown = np.zeros(0, np.int64), np.zeros(0)

_AT_ONCE = 2_000  # masses of a place at a velocity that are moved at once, for 1 MB of memory


@constants
class BELIEF:
    """Engineering; only `jumping` was measured (docs/NOTES.md)."""

    # Shares of mass, per keyframe.
    entering: float = 0.004  # of elsewhere: enters the map, evenly; of copies: they end
    # Of what is lost, at a start or where a session ends: enters the map, but at most
    # `COPIES.cells` for each place of earlier drives, so that cells decide in no single frame.
    lost: float = 0.5
    told: float = 0.5  # of all: is at the places where others say that the robot is
    # Of each place: leaves the map; of all: enters, as a robot may be moved, or odometry fail.
    jumping: float = 5e-4
    sharing: float = 0.1  # of a place: moves to its other looks


class Belief:
    """
    Probabilities of the places and of `elsewhere`; they sum to 1.

    At first all mass is elsewhere. Only `places`, (n,), ascending, hold mass. At a place, it is
    held by velocity and by state of the keypoints, as if the one did not depend on the other.
    `onward` returns which places of earlier drives show the scene of the last place of one.
    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        motion: MotionModel,
        lead: ExpectedLead,
        onward: Callable[[int, int], Shown] = lambda _last, _earlier: _NOWHERE,
    ) -> None:
        self._map, self.motion, self._lead, self._onward = reference_map, motion, lead, onward
        self.reset()

    def reset(self) -> None:
        """Forget the drive: the robot is elsewhere."""
        self.motion.reset()
        self.places: Indices = np.zeros(0, np.int64)
        self._mass: Doubles = np.zeros((len(self.motion.velocities), 0))  # with that of copies
        self._states: Doubles = np.zeros((STATES, 0))  # the same mass
        self._nowhere = 1.0  # mass of elsewhere that is at no copy of a place
        self._lost = 1.0  # part of it of which nothing is known

    def expect(self, places: Indices, weights: Doubles, earlier: int) -> None:
        """
        Begin with mass at places (n,), ascending, by weights (n,) of sum 1; the rest is lost.

        `earlier` is the number of places of earlier drives.
        """
        self.reset()
        share = BELIEF.told * weights
        self.places, self._mass = places, self.motion.prior[:, None] * share
        self._states = self._lead.entering(places, earlier) * share
        self._nowhere = self._lost = 1 - BELIEF.told

    @property
    def mass(self) -> Doubles:
        """Probability that the newest frame shows each of `places`, (n,)."""
        return np.asarray(self._states[:-1].sum(axis=0))

    @property
    def elsewhere(self) -> float:
        """Probability that the newest frame shows no place; copies of places are elsewhere."""
        return self._nowhere + float(self._states[-1].sum())

    def likeliest(self, count: int) -> list[int]:
        """Return the `count` likeliest places, best first."""
        order = np.argsort(-self.mass, kind='stable')
        return self.places[order[:count]].tolist()

    def velocity(self, place: int) -> float:
        """Return the likeliest velocity at a place, in places per keyframe; 1 without mass."""
        at = int(np.searchsorted(self.places, place))
        if at == len(self.places) or self.places[at] != place:
            return 1.0
        return float(self.motion.velocities[self._mass[:, at].argmax()])

    def states_at(self, places: Indices, earlier: int) -> Doubles:
        """
        Return the probabilities (6, n) of the states of the keypoints at places (n,).

        Where no mass is, they are those of mass that enters.
        """
        states = self._lead.entering(places, earlier)
        held = np.isin(places, self.places)
        mass = self._states[:, np.searchsorted(self.places, places[held])]
        states[:, held] = mass / mass.sum(axis=0)
        return states

    def expected_leads(self, is_same: Flags) -> Doubles:
        """Return the mass (5,) of the expected leads at some of `places` (n,)."""
        return np.asarray(self._states[:-1, is_same].sum(axis=1))

    def predict(self, usable: int, earlier: int) -> None:
        """
        Move the mass; mass that leaves its session, or the usable places, is lost elsewhere.

        What leaves the end of an earlier drive goes on where its last scene is seen, as at the
        beginning of a lap. `earlier` is the number of places of earlier drives.
        """
        if not len(self.places):
            return
        around, same, arrived, total, left = self._moved(*self._with_looks(usable), usable)
        reached = np.flatnonzero(arrived.any(axis=0))
        same, arrived = same.take(reached, axis=1), arrived.take(reached, axis=1)
        self.places = around[reached]
        other = self.motion.prior[:, None] * same.sum(axis=0)
        other *= MOTION.changing
        same *= 1 - MOTION.changing
        same += other
        self._lost += max(0.0, total - float(same.sum()))
        after = self._lead.moved(arrived, self.places, earlier, BELIEF.entering)
        after *= 1 - BELIEF.jumping
        same *= after.sum(axis=0)
        same /= arrived.sum(axis=0)
        self._mass, self._states = same, after
        for end, share in left.items():
            if end <= earlier and share > BUDGET.shares_from:
                self._go_on(share, *self._onward(end - 1, earlier), earlier)
        self._nowhere = max(0.0, 1.0 - float(self._states.sum()))

    def _go_on(self, mass: float, places: Indices, shares: Doubles, earlier: int) -> None:
        """Put mass at places (n,) that show its scene by some shares; what none shows is lost."""
        if not len(places):
            return
        added = mass * shares.max() * shares / shares.sum()
        whole = np.union1d(self.places, places)
        at, to = np.searchsorted(whole, self.places), np.searchsorted(whole, places)
        held, states = np.zeros((len(self._mass), len(whole))), np.zeros((STATES, len(whole)))
        held[:, at], states[:, at] = self._mass, self._states
        held[:, to] += self.motion.prior[:, None] * added
        states[:, to] += self._lead.entering(places, earlier) * added
        self.places, self._mass, self._states = whole, held, states
        self._lost = max(0.0, self._lost - float(added.sum()))

    def update(
        self,
        places: Indices,
        log_ratios: Doubles,
        entry: Doubles,
        usable: int,
        earlier: int,
        keypoints: Doubles | None = None,
    ) -> None:
        """
        Multiply the mass of places (n,), ascending, by their likelihood ratios.

        `places` has all places that hold mass, and may have more of the first `usable` places.
        `log_ratios` (n,) are logarithms: how many times likelier the frame is there than
        elsewhere. `entry` (n,), in [0, 1], is the share of entering mass that odometry allows.
        `earlier` is the number of places of earlier drives, where a lost robot may be.
        `keypoints` (6, n) are likelihood ratios of the keypoints alone, by state; without, the
        shares of the states stay.
        """
        at, count = np.searchsorted(places, self.places), len(places)
        mass, states = np.zeros((len(self._mass), count)), np.zeros((STATES, count))
        mass[:, at], states[:, at] = self._mass, self._states
        entering = BELIEF.entering * (self._nowhere - self._lost)
        entering += min(BELIEF.lost, COPIES.cells * earlier) * self._lost
        share = (entering * entry + BELIEF.jumping) / max(1, usable)
        mass += self.motion.prior[:, None] * share
        mass *= np.exp(log_ratios)
        states += self._lead.entering(places, earlier) * share
        if keypoints is not None:
            states *= keypoints
        nowhere, self._lost = self._nowhere - entering, 0.0
        total = float(mass.sum()) + nowhere
        mass /= total
        self._nowhere = nowhere / total
        kept = mass.sum(axis=0) > BUDGET.least
        self.places, self._mass, states = places[kept], mass[:, kept], states[:, kept]
        self._states = states * (self._mass.sum(axis=0) / states.sum(axis=0))

    def _moved(
        self, places: Indices, mass: Doubles, states: Doubles, usable: int
    ) -> tuple[Indices, Doubles, Doubles, float, dict[int, float]]:
        """
        Return places, the mass that arrives there by velocity and by state, and all that moved.

        At last what left sessions at their end, by the place after it. Each sum is in the order of
        velocities and places, so the parts make no difference.
        """
        held = np.flatnonzero(mass > BUDGET.least)  # of all velocities at all places
        centres, sigmas = (one.ravel()[held] for one in self.motion.moved(places))
        reach = math.ceil(3 * min(sigmas.max(initial=0.0), BUDGET.widest))
        spans = self._map.bounds.spans(places)
        firsts, stops = (np.broadcast_to(bound, places.shape) for bound in spans)
        stops = np.minimum(stops, usable)
        ends, number_of_end = np.unique(stops, return_inverse=True)
        left = np.zeros(len(ends))
        around, total = _around(centres, reach, usable), float(mass.sum())
        states /= states.sum(axis=0)
        number = np.empty(usable, np.int64)  # of a place in `around`
        number[around] = np.arange(len(around))
        same, arrived = np.zeros((len(mass), len(around))), np.zeros((STATES, len(around)))
        for start in range(0, len(held), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            velocities, columns = np.divmod(held[part], len(places))
            centre, sigma = centres[part, None], sigmas[part, None]
            near = np.rint(centre) + np.arange(-reach, reach + 1)
            weights = np.exp(-0.5 * ((near - centre) / sigma) ** 2)
            weights *= (mass[velocities, columns] / weights.sum(axis=1))[:, None]
            is_beyond = near >= stops[columns, None]
            if is_beyond.any():
                np.add.at(left, number_of_end[columns], (weights * is_beyond).sum(axis=1))
            kept = (near >= firsts[columns, None]) & ~is_beyond
            kept &= weights > BUDGET.least
            where, weights = number[near[kept].astype(np.int64)], weights[kept]
            rows, sources = (np.repeat(one, kept.sum(axis=1)) for one in (velocities, columns))
            np.add.at(same.ravel(), rows * len(around) + where, weights)
            for row, state in zip(arrived, states, strict=True):
                np.add.at(row, where, state[sources] * weights)
        return around, same, arrived, total, dict(zip(ends.tolist(), left.tolist(), strict=True))

    def _with_looks(self, usable: int) -> tuple[Indices, Doubles, Doubles]:
        """
        Return places, and their mass by velocity and by state.

        A share of the mass is moved to the other looks (keyframes) of places.
        """
        places, mass = self.places, np.vstack((self._mass, self._states))
        of_velocities = len(self._mass)
        strong = np.flatnonzero(self._mass.sum(axis=0) > BUDGET.shares_from)
        shared = dict[int, Doubles]()
        for column in strong.tolist():
            looks = [look for look in self._map.links.looks(int(places[column])) if look < usable]
            if looks:
                share = BELIEF.sharing * mass[:, column]
                mass[:, column] -= share
                for look in looks:
                    shared[look] = shared.get(look, 0.0) + share / len(looks)
        if shared:
            all_places = np.union1d(places, np.fromiter(shared, np.int64))
            all_mass = np.zeros((len(mass), len(all_places)))
            all_mass[:, np.searchsorted(all_places, places)] = mass
            for look, share in shared.items():
                all_mass[:, np.searchsorted(all_places, look)] += share
            places, mass = all_places, all_mass
        return places, mass[:of_velocities], mass[of_velocities:]


def _around(centres: Doubles, reach: int, usable: int) -> Indices:
    """Return which of the first `usable` places (m,) are within a reach of centres (n,)."""
    begun = np.zeros(usable + 1, np.int32)  # ranges that begin at a place, less those that ended
    for offset, change in ((-reach, 1), (reach + 1, -1)):
        edges = (np.rint(centres) + offset).clip(0, usable)
        np.add.at(begun, edges.astype(np.int64), change)
    return np.flatnonzero(begun[:-1].cumsum())
