# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The motion: where a robot that was at a place is one keyframe later."""

from functools import lru_cache, partial
import math

from convseq_ros.core.decision.odometry import Odometer
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import matrix
from convseq_ros.core.types import constants, Doubles, Indices, Pose
import numpy as np

_KEPT = 2_000  # places whose distances to the next one are cached; 0.4 MB


@constants
class MOTION:
    """Engineering; only a sigma of 0.8 was measured: it costs laps 2 of 684 (docs/NOTES.md)."""

    # Hypotheses for the velocity relative to the drive of the map, in places per keyframe.
    velocities: tuple[float, ...] = (0.0, 0.5, 0.8, 1.0, 1.25, 2.0, 3.0, 4.5, 6.0)
    sigma_places: float = 0.55  # noise of the position per step, in places
    # Share of mass that takes another velocity, per keyframe; also the prior of drives that meet
    # the places in reverse order.
    changing: float = 0.01


class MotionModel:
    """
    Moves places by odometry if it and the map's poses are known, otherwise by a velocity.

    With `both` directions, the places are met in reverse order with a probability of 50 %,
    otherwise of 1 %. The motion spreads by `way_error`, the drift of odometry as a share of the
    travelled distance; without odometry, too.
    """

    def __init__(self, reference_map: ReferenceMap, both: bool, way_error: float) -> None:
        ahead = MOTION.velocities
        back = tuple(-velocity for velocity in ahead if velocity)
        backwards = 0.5 if both else MOTION.changing
        shares = (1 - backwards) / len(ahead), backwards / len(back)
        self.velocities: Doubles = np.array((*ahead, *back))
        self.prior: Doubles = np.repeat(shares, (len(ahead), len(back)))  # by velocity; sum is 1
        self._map, self._way_error = reference_map, way_error
        # Not a bound method: without a reference cycle, an unused map is freed at once.
        self._step_m = lru_cache(_KEPT)(partial(_step_m, reference_map))
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
        sigmas = moved - places
        np.abs(sigmas, out=sigmas)
        sigmas *= self._way_error
        sigmas += MOTION.sigma_places
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


def _step_m(reference_map: ReferenceMap, place: int) -> float | None:
    """Return the distance from a place to the next one; None if a pose is missing."""
    here, there = (reference_map.places.position(index) for index in (place, place + 1))
    return math.dist(here, there) if here and there else None
