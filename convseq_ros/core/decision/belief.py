# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The belief: a discrete Bayes filter over places, velocities and *elsewhere*.

One step a keyframe: `predict` moves the mass as the robot may have moved, `update` multiplies it
by what the frame shows. Only places that hold mass, or were looked at, are kept, so a step costs
what they are, whatever the size of the map.

Sources: Hansen and Browning 2014 (SeqSLAM as a hidden Markov model); Xu, Suenderhauf and Milford
2020 (an off-map state).
"""

import math

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import matrix
from convseq_ros.core.types import constants, Doubles, Indices, Pose
import numpy as np

_WIDEST = 20.0  # places: of a sigma of the motion that is followed to its ends


@constants
class BELIEF:
    """Engineering, insensitive between half and twice (docs/MATCHING.md)."""

    # Places a keyframe: hypotheses about how fast the drive is, against the drive of the map.
    velocities: tuple[float, ...] = (0.0, 0.5, 0.8, 1.0, 1.25, 2.0, 3.0, 4.5, 6.0)
    sigma_places: float = 0.55  # of where a keyframe lies between two places of the map
    # Shares of the mass a keyframe. So many take up another velocity, and so many drives meet the
    # places in reverse order.
    changing: float = 0.01
    entering: float = 0.004  # of elsewhere, that enters the map, evenly over its places
    leaving: float = 0.0005  # of each place, that leaves the map
    jumping: float = 1e-4  # of all, that is anywhere in the map: kidnapped, or odometry is wrong
    looks: float = 0.1  # of a place, that goes on from its other looks
    least: float = 1e-9  # of all; a place with less holds none


class MotionModel:
    """
    Moves places by odometry, where it and poses of the map are known, else by a velocity.

    With `both` directions a drive meets the places in reverse order as often as not, else hardly
    ever. `way_error` is the share of the way by which odometry may be off.
    """

    def __init__(self, reference_map: ReferenceMap, both: bool, way_error: float) -> None:
        ahead = BELIEF.velocities
        back = tuple(-one for one in ahead if one)
        backwards = 0.5 if both else BELIEF.changing
        shares = (1 - backwards) / len(ahead), backwards / len(back)
        self.velocities: Doubles = np.array((*ahead, *back))
        self.prior: Doubles = np.repeat(shares, (len(ahead), len(back)))  # of velocities, 1 in sum
        self._map, self._way_error = reference_map, way_error
        self._steps_m = dict[int, float | None]()  # from a place to the next one
        self.reset()

    def reset(self) -> None:
        self._pose: Pose | None = None
        self._total_m, self._ways = 0.0, 0  # of the drive, as far as odometry knew
        # Since the keyframe before, negative in reverse gear; None if it is not known.
        self._way_m: float | None = None
        self._keyframes = 1.0

    def move(self, pose: Pose | None, missing: int, novelty: float = 1.0) -> None:
        """
        Take in where odometry is at the next keyframe, and how many were dropped before it.

        `novelty` in [0, 1] says how much of the image is new: a robot that stands does not move.
        """
        self._way_m, self._keyframes = None, missing + novelty
        if pose is not None and self._pose is not None:
            before, now = matrix(self._pose), np.array(pose.position)
            ahead_m = float((now - before[:3, 3]) @ before[:3, 0])
            self._way_m = math.copysign(math.dist(now, before[:3, 3]), ahead_m)
            self._total_m, self._ways = self._total_m + abs(self._way_m), self._ways + 1
        self._pose = pose

    def moved(self, places: Indices) -> tuple[Doubles, Doubles]:
        """
        Return where the robot may be that was at places (n,): (V, n) by velocity, and sigmas.

        Both count places of the map, from its first; what lies beyond a session is on no place.
        """
        pace = self._keyframes
        if self._way_m is not None and self._total_m > 0:
            pace = self._way_m * self._ways / self._total_m
        moved = places + pace * self.velocities[:, None]
        if self._way_m is not None:
            forwards = self.velocities >= 0
            for column, place in enumerate(places.tolist()):
                for some, way_m in ((forwards, self._way_m), (~forwards, -self._way_m)):
                    if (end := self._along(place, way_m)) is not None:
                        moved[some, column] = end
        sigmas = BELIEF.sigma_places + self._way_error * abs(moved - places)
        return moved, sigmas

    def _along(self, place: int, way_m: float) -> float | None:
        """Return where a way along the places of a session ends; None if poses do not tell."""
        first, end = self._map.bounds.span(place)
        end = min(end, len(self._map))
        at, left_m, step_m, direction = place, abs(way_m), 0.0, 1 if way_m > 0 else -1
        while first <= at + direction < end:
            known_m = self._step_m(min(at, at + direction))
            if known_m is None:
                return None
            step_m = known_m
            if left_m <= step_m:
                return at + direction * left_m / step_m if step_m else float(at)
            at, left_m = at + direction, left_m - step_m
        # Beyond the end of the session, as far apart as its last places.
        return at + direction * left_m / step_m if step_m else None

    def _step_m(self, place: int) -> float | None:
        """Return the way from a place to the next one of its session, if poses tell."""
        if place not in self._steps_m:
            one, other = (self._map.places[index].pose for index in (place, place + 1))
            self._steps_m[place] = (
                math.dist(one.position, other.position) if one and other else None
            )
        return self._steps_m[place]


class Belief:
    """
    Holds the mass, 1 with that of `elsewhere`, and moves it; at first all is there.

    Only `places`, (n,), ascending, hold any.
    """

    def __init__(self, reference_map: ReferenceMap, motion: MotionModel) -> None:
        self._map, self.motion = reference_map, motion
        self.reset()

    def reset(self) -> None:
        """Forget the drive: the robot is elsewhere."""
        self.motion.reset()
        self.places: Indices = np.zeros(0, np.int64)
        self._mass: Doubles = np.zeros((len(self.motion.velocities), 0))
        self.elsewhere = 1.0

    @property
    def mass(self) -> Doubles:
        """How likely the newest frame shows each of `places`, (n,)."""
        return np.asarray(self._mass.sum(axis=0))

    def likeliest(self, count: int) -> list[int]:
        """Return the likeliest places, best first, however little mass they hold."""
        order = np.argsort(-self.mass, kind='stable')
        return self.places[order[:count]].tolist()

    def velocity(self, place: int) -> float:
        """Return the likeliest velocity at a place, in places a keyframe; 1 if it has no mass."""
        at = int(np.searchsorted(self.places, place))
        if at == len(self.places) or self.places[at] != place:
            return 1.0
        return float(self.motion.velocities[self._mass[:, at].argmax()])

    def predict(self, usable: int) -> None:
        """Move the mass; what runs off its session, or the usable places, is elsewhere."""
        if not len(self.places):
            return
        places, mass = self._with_looks(usable)
        velocities, columns = np.nonzero(mass > BELIEF.least)
        moved, sigmas = (one[velocities, columns] for one in self.motion.moved(places))
        reach = math.ceil(3 * min(sigmas.max(initial=0.0), _WIDEST))
        near = np.rint(moved)[:, None] + np.arange(-reach, reach + 1)
        weights = np.exp(-0.5 * ((near - moved[:, None]) / sigmas[:, None]) ** 2)
        weights *= (mass[velocities, columns] / weights.sum(axis=1))[:, None]
        spans = self._map.bounds.spans(places)
        firsts, stops = (np.broadcast_to(one, places.shape) for one in spans)
        there = near >= firsts[columns, None]
        there &= near < np.minimum(stops, usable)[columns, None]
        kept = there & (weights > BELIEF.least)
        self.places, where = np.unique(near[kept].astype(np.int64), return_inverse=True)
        rows = np.repeat(velocities, kept.sum(axis=1))
        count = len(self.places)
        flat = np.bincount(rows * count + where, weights[kept], len(mass) * count)
        own = flat.reshape(len(mass), count)
        anew = self.motion.prior[:, None] * own.sum(axis=0)
        changed = (1 - BELIEF.changing) * own + BELIEF.changing * anew
        self._mass = np.asarray((1 - BELIEF.leaving) * changed, np.float64)
        self.elsewhere = max(0.0, 1.0 - float(self._mass.sum()))

    def update(self, places: Indices, log_ratios: Doubles, entry: Doubles, usable: int) -> None:
        """
        Multiply the mass by how likely places (n,), ascending, show what the frame shows.

        They are all that hold mass, and perhaps others of the `usable` first ones. `log_ratios`
        (n,): of how many times likelier the frame is there than elsewhere; `entry` (n,): share in
        [0, 1] of what usually enters there that odometry allows.
        """
        mass = np.zeros((len(self._mass), len(places)))
        mass[:, np.searchsorted(places, self.places)] = self._mass
        share = BELIEF.entering * self.elsewhere * entry + BELIEF.jumping
        mass += self.motion.prior[:, None] * share / max(1, usable)
        mass *= np.exp(log_ratios)
        elsewhere = self.elsewhere * (1 - BELIEF.entering)
        total = float(mass.sum()) + elsewhere
        mass, self.elsewhere = mass / total, elsewhere / total
        kept = mass.sum(axis=0) > BELIEF.least
        self.places, self._mass = places[kept], mass[:, kept]

    def _with_looks(self, usable: int) -> tuple[Indices, Doubles]:
        """Return the mass, a share of each place's on its other looks."""
        places, mass = self.places, self._mass.copy()
        strong = np.flatnonzero(mass.sum(axis=0) > 1e-3)
        shared = dict[int, Doubles]()
        for column in strong.tolist():
            looks = [one for one in self._map.links.looks(int(places[column])) if one < usable]
            if looks:
                share = BELIEF.looks * mass[:, column]
                mass[:, column] -= share
                for one in looks:
                    shared[one] = shared.get(one, 0.0) + share / len(looks)
        if not shared:
            return places, mass
        every = np.union1d(places, np.fromiter(shared, np.int64))
        whole = np.zeros((len(mass), len(every)))
        whole[:, np.searchsorted(every, places)] = mass
        for one, share in shared.items():
            whole[:, np.searchsorted(every, one)] += share
        return every, whole
