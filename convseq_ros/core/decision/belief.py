# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The belief: a discrete Bayes filter over places, velocities, usual leads and *elsewhere*.

Each keyframe is one step: `predict` moves the mass as the robot may have moved, and `update`
multiplies it by the likelihood ratios of the frame. Only places that hold mass are kept, so the
time of a step depends on their number, not on the size of the map.

Sources: Hansen and Browning 2014 (SeqSLAM as a hidden Markov model); Xu, Suenderhauf and Milford
2020 (an off-map state).
"""

import math

from convseq_ros.core.decision.likelihood import COPIES
from convseq_ros.core.decision.odometer import Odometer
from convseq_ros.core.decision.usual_lead import STATES, UsualLead
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import matrix
from convseq_ros.core.types import constants, Doubles, Flags, Indices, Pose
import numpy as np

_WIDEST = 20.0  # places; a larger sigma of the motion is cut off at 3 times this


@constants
class BELIEF:
    """Engineering, insensitive between half and twice (docs/MATCHING.md)."""

    # Hypotheses for the velocity relative to the drive of the map, in places per keyframe.
    velocities: tuple[float, ...] = (0.0, 0.5, 0.8, 1.0, 1.25, 2.0, 3.0, 4.5, 6.0)
    sigma_places: float = 0.55  # noise of the position per step, in places
    # Shares of mass that move, per keyframe.
    # To other velocities; also the prior of drives that meet the places in reverse order.
    changing: float = 0.01
    # Of elsewhere: enters the map, evenly over its places. As much of copies ends ...
    entering: float = 0.004
    # ... and of what is lost, at a start or where a session ends: as likely in the map as not,
    # but so little at a place that no frame decides alone.
    lost: float = 0.5
    # Of each place: leaves the map. As much of all: anywhere in the map, if the robot is moved or
    # odometry fails.
    jumping: float = 5e-4
    looks: float = 0.1  # of a place: moves to the other keyframes of the same place
    least: float = 1e-9  # of all; a place with less mass is dropped


class MotionModel:
    """
    Moves places by odometry if it and the map's poses are known, otherwise by a velocity.

    With `both` directions, the places are met in reverse order with a probability of 50 %,
    otherwise of 1 %. `way_error` is the drift of odometry, as a share of the travelled distance.
    """

    def __init__(self, reference_map: ReferenceMap, both: bool, way_error: float) -> None:
        ahead = BELIEF.velocities
        back = tuple(-velocity for velocity in ahead if velocity)
        backwards = 0.5 if both else BELIEF.changing
        shares = (1 - backwards) / len(ahead), backwards / len(back)
        self.velocities: Doubles = np.array((*ahead, *back))
        self.prior: Doubles = np.repeat(shares, (len(ahead), len(back)))  # by velocity; sum is 1
        self._map, self._way_error = reference_map, way_error
        self._steps_m = dict[int, float | None]()  # from a place to the next one
        self.reset()

    def reset(self) -> None:
        self._odometer = Odometer()
        # Distance from the last keyframe, negative in reverse gear; None without odometry.
        self._driven_m: float | None = None
        self._keyframes = 1.0

    def move(self, pose: Pose | None, missing: int, novelty: float = 1.0) -> None:
        """
        Take in the odometry pose of the next keyframe, and how many were dropped before it.

        `novelty` in [0, 1] is how new the image is: it scales the motion if there is no odometry.
        """
        self._driven_m, self._keyframes = None, missing + novelty
        if pose is None:
            self.forget_pose()
        else:
            self._driven_m = self._odometer.move(matrix(pose))

    def forget_pose(self) -> None:
        """Forget the last pose: the step to the next one is unknown."""
        self._odometer.forget_pose()

    def moved(self, places: Indices) -> tuple[Doubles, Doubles]:
        """
        Return where a robot at places (n,) is now, by velocity, and the sigmas: both (V, n).

        Both are in places, as indices of the map. A result may lie beyond the end of its session.
        """
        pace, driven_m = self._keyframes, self._driven_m
        if driven_m is not None and self._odometer.distance_m > 0:
            pace = driven_m * self._odometer.steps / self._odometer.distance_m
        moved = places + pace * self.velocities[:, None]
        if driven_m is not None:
            forwards = self.velocities >= 0
            for column, place in enumerate(places.tolist()):
                for rows, distance_m in ((forwards, driven_m), (~forwards, -driven_m)):
                    if (end := self._along(place, distance_m)) is not None:
                        moved[rows, column] = end
        sigmas = BELIEF.sigma_places + self._way_error * abs(moved - places)
        return moved, sigmas

    def _along(self, place: int, distance_m: float) -> float | None:
        """Return the place at a distance along the session; None if a pose is missing."""
        first, end = self._map.bounds.span(place)
        end = min(end, len(self._map))
        at, left_m, step_m, direction = place, abs(distance_m), 0.0, 1 if distance_m > 0 else -1
        while first <= at + direction < end:
            next_m = self._step_m(min(at, at + direction))
            if next_m is None:
                return None
            step_m = next_m
            if left_m <= step_m:
                return at + direction * left_m / step_m if step_m else float(at)
            at, left_m = at + direction, left_m - step_m
        # Beyond the end of the session, places are as far apart as the last two.
        return at + direction * left_m / step_m if step_m else None

    def _step_m(self, place: int) -> float | None:
        """Return the distance from a place to the next one; None if a pose is missing."""
        if place not in self._steps_m:
            here, there = (self._map.places[index].pose for index in (place, place + 1))
            self._steps_m[place] = (
                math.dist(here.position, there.position) if here and there else None
            )
        return self._steps_m[place]


class Belief:
    """
    Probabilities of the places and of `elsewhere`; they sum to 1.

    At first all mass is elsewhere. Only `places`, (n,), ascending, hold mass. At a place, it is
    held by velocity and by state of the keypoints, as if the one did not depend on the other.
    """

    def __init__(self, reference_map: ReferenceMap, motion: MotionModel, usual: UsualLead) -> None:
        self._map, self.motion, self._usual = reference_map, motion, usual
        self.reset()

    def reset(self) -> None:
        """Forget the drive: the robot is elsewhere."""
        self.motion.reset()
        self.places: Indices = np.zeros(0, np.int64)
        self._mass: Doubles = np.zeros((len(self.motion.velocities), 0))  # with that of copies
        self._states: Doubles = np.zeros((STATES, 0))  # the same mass
        self._apart = 1.0  # mass of elsewhere that is at no copy of a place
        self._lost = 1.0  # part of it of which nothing is known

    @property
    def mass(self) -> Doubles:
        """Probability that the newest frame shows each of `places`, (n,)."""
        return np.asarray(self._states[:-1].sum(axis=0))

    @property
    def elsewhere(self) -> float:
        """Probability that the newest frame shows no place; copies of places are elsewhere."""
        return self._apart + float(self._states[-1].sum())

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
        states = self._usual.entering(places >= earlier)
        held = np.isin(places, self.places)
        mass = self._states[:, np.searchsorted(self.places, places[held])]
        states[:, held] = mass / mass.sum(axis=0)
        return states

    def usual_leads(self, is_same: Flags) -> Doubles:
        """Return the mass (5,) of the usual leads at some of `places` (n,)."""
        return np.asarray(self._states[:-1, is_same].sum(axis=1))

    def predict(self, usable: int, earlier: int) -> None:
        """
        Move the mass; mass that leaves its session, or the usable places, is lost elsewhere.

        `earlier` is the number of places of earlier drives.
        """
        if not len(self.places):
            return
        places, mass, states = self._with_looks(usable)
        velocities, columns = np.nonzero(mass > BELIEF.least)
        moved, sigmas = (values[velocities, columns] for values in self.motion.moved(places))
        reach = math.ceil(3 * min(sigmas.max(initial=0.0), _WIDEST))
        near = np.rint(moved)[:, None] + np.arange(-reach, reach + 1)
        weights = np.exp(-0.5 * ((near - moved[:, None]) / sigmas[:, None]) ** 2)
        weights *= (mass[velocities, columns] / weights.sum(axis=1))[:, None]
        spans = self._map.bounds.spans(places)
        firsts, stops = (np.broadcast_to(bound, places.shape) for bound in spans)
        is_inside = near >= firsts[columns, None]
        is_inside &= near < np.minimum(stops, usable)[columns, None]
        kept = is_inside & (weights > BELIEF.least)
        self.places, where = np.unique(near[kept].astype(np.int64), return_inverse=True)
        count, weights = len(self.places), weights[kept]
        rows, sources = (np.repeat(one, kept.sum(axis=1)) for one in (velocities, columns))
        same = _summed(rows * count + where, weights, len(mass), count)
        other = self.motion.prior[:, None] * same.sum(axis=0)
        changed = (1 - BELIEF.changing) * same + BELIEF.changing * other
        self._lost = max(0.0, float(mass.sum() - changed.sum()))
        states /= states.sum(axis=0)
        at = (np.arange(STATES)[:, None] * count + where).ravel()
        arrived = _summed(at, (states[:, sources] * weights).ravel(), STATES, count)
        stays = (1 - BELIEF.jumping) * self._usual.moved(
            arrived, self.places >= earlier, BELIEF.entering
        )
        self._mass, self._states = changed * stays.sum(axis=0) / arrived.sum(axis=0), stays
        self._apart = max(0.0, 1.0 - float(stays.sum()))

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
        entering = BELIEF.entering * (self._apart - self._lost)
        entering += min(BELIEF.lost, COPIES.all * earlier) * self._lost
        share = (entering * entry + BELIEF.jumping) / max(1, usable)
        mass += self.motion.prior[:, None] * share
        mass *= np.exp(log_ratios)
        states += self._usual.entering(places >= earlier) * share
        if keypoints is not None:
            states *= keypoints
        apart, self._lost = self._apart - entering, 0.0
        total = float(mass.sum()) + apart
        mass, self._apart = mass / total, apart / total
        kept = mass.sum(axis=0) > BELIEF.least
        self.places, self._mass, states = places[kept], mass[:, kept], states[:, kept]
        self._states = states * (self._mass.sum(axis=0) / states.sum(axis=0))

    def _with_looks(self, usable: int) -> tuple[Indices, Doubles, Doubles]:
        """
        Return places, and their mass by velocity and by state.

        A share of the mass is moved to the other looks (keyframes) of places.
        """
        places, mass = self.places, np.vstack((self._mass, self._states))
        of_velocities = len(self._mass)
        strong = np.flatnonzero(self._mass.sum(axis=0) > 1e-3)
        shared = dict[int, Doubles]()
        for column in strong.tolist():
            looks = [look for look in self._map.links.looks(int(places[column])) if look < usable]
            if looks:
                share = BELIEF.looks * mass[:, column]
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


def _summed(at: Indices, weights: Doubles, rows: int, count: int) -> Doubles:
    """Return the sums (rows, count) of weights (m,), by their flat positions (m,)."""
    return np.asarray(np.bincount(at, weights, rows * count).reshape(rows, count), np.float64)
