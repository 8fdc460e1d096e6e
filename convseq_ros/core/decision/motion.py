# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The motion model: to which places the robot may have come from a place since the last frame."""

import math

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import matrix
from convseq_ros.core.types import constants, Doubles, Indices, Pose
import numpy as np


@constants
class MOTION:
    """Of the prediction; engineering, insensitive between half and twice (docs/MATCHING.md)."""

    # Places a keyframe: hypotheses about how fast the drive is, against the drive of the map.
    velocities: tuple[float, ...] = (0.0, 0.5, 0.8, 1.0, 1.25, 2.0, 3.0, 4.5, 6.0)
    # Share of the mass that takes up another velocity in a keyframe, and of the drives that meet
    # the places in reverse order.
    changing: float = 0.01
    sigma_places: float = 0.55  # of where a keyframe lies between two places of the map


class MotionModel:
    """
    Moves places by odometry, where it and poses of the map are known, else by a velocity.

    With `both` directions a drive meets the places in reverse order as often as not, else hardly
    ever. `way_error` is the share of the way by which odometry may be off.
    """

    def __init__(self, reference_map: ReferenceMap, both: bool, way_error: float) -> None:
        ahead = MOTION.velocities
        back = tuple(-one for one in ahead if one)
        backwards = 0.5 if both else MOTION.changing
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
        sigmas = MOTION.sigma_places + self._way_error * abs(moved - places)
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
