# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The odometer: how far a robot has driven and turned, by the poses of odometry."""

import math

from convseq_ros.core.rigid import angle, Matrix


class Odometer:
    """
    Adds up the steps between successive poses (4, 4) of the base in odometry.

    The motion has one for each camera: a keyframe without a pose breaks it off, since its mean
    step is that between keyframes. The odometry prior has one for all cameras of a robot, which
    goes on across such keyframes, since drift does.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin a drive."""
        self.distance_m, self.turn_rad, self.steps = 0.0, 0.0, 0
        self.forget_pose()

    def forget_pose(self) -> None:
        """Forget the last pose: the step to the next one is unknown."""
        self._last: Matrix | None = None

    def move(self, here: Matrix) -> float | None:
        """Take in the next pose; return its distance in metres from the last, < 0 in reverse."""
        last, self._last = self._last, here
        if last is None:
            return None
        moved = here[:3, 3] - last[:3, 3]
        step_m = math.hypot(*moved.tolist())
        self.distance_m += step_m
        self.turn_rad += angle(last[:3, :3].T @ here[:3, :3])
        self.steps += 1
        return math.copysign(step_m, float(moved @ last[:3, 0]))
