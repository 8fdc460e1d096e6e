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

from convseq_ros.core.decision.motion import MOTION, MotionModel
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Doubles, Indices
import numpy as np

_WIDEST = 20.0  # places: of a sigma of the motion that is followed to its ends


@constants
class BELIEF:
    """Shares of the mass a keyframe; engineering, insensitive between half and twice."""

    entering: float = 0.004  # of elsewhere, that enters the map, evenly over its places
    leaving: float = 0.0005  # of each place, that leaves the map
    jumping: float = 1e-4  # of all, that is anywhere in the map: kidnapped, or odometry is wrong
    looks: float = 0.1  # of a place, that goes on from its other looks
    least: float = 1e-9  # of all; a place with less holds none


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
        changed = (1 - MOTION.changing) * own + MOTION.changing * anew
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
