# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps of odometry that no robot can have made: a reset, an outlier or a wrong unit."""

import math

from convseq_ros.core.types import Pose, ROBOT


class OdometryJumps:
    """Compares each pose with the one before."""

    def __init__(self) -> None:
        self.count = 0  # since the start
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._last: tuple[int, Pose] | None = None

    def observe(self, stamp_ns: int, pose: Pose | None) -> bool:
        """Take in the next pose; return whether the step to it is too fast for a robot."""
        if pose is None:
            return False
        last, self._last = self._last, (stamp_ns, pose)
        if last is None:
            return False
        duration_s = max(0, stamp_ns - last[0]) / 1e9
        is_jump = math.dist(pose.position, last[1].position) > ROBOT.fastest_mps * duration_s
        self.count += is_jump
        return is_jump
