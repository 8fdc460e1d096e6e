# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Standstill, by odometry or, without it, by the image."""

import math

from convseq_ros.config import MotionConfig
from convseq_ros.core.encoding.glance import distance, Glance
from convseq_ros.core.types import constants, Pose


@constants
class NEAR:
    """Engineering."""

    turn_rad: float = math.tau / 20  # smallest turn that counts as motion


def near(pose: Pose, other: Pose, distance_m: float) -> bool:
    """Return whether a pose is within a distance of another, and turned by less than 18°."""
    cosine = abs(sum(a * b for a, b in zip(pose.orientation, other.orientation, strict=True)))
    turn_rad = 2 * math.acos(min(cosine, 1.0))
    return math.dist(pose.position, other.position) < distance_m and turn_rad < NEAR.turn_rad


class Standstill:
    """Detects standstill by the last frame that moved, so that slow motion adds up."""

    def __init__(self, config: MotionConfig, by_image: bool) -> None:
        self._config = config
        self._by_image = by_image and config.stationary_glance > 0  # if there is no odometry
        self.reset()

    def configure(self, config: MotionConfig) -> None:
        """Use another `stationary_m` from now on."""
        self._config = config

    def reset(self) -> None:
        self._pose: Pose | None = None
        self._edges: Glance | None = None

    def check(self, pose: Pose | None, edges: Glance | None) -> bool:
        """Return whether the robot stands still at a frame, by its pose, or else by its glance."""
        if not self.needs_image(pose):
            return bool(self._by_pose(pose))
        if edges is None or self._edges is None:
            return False
        return distance(edges, self._edges) < self._config.stationary_glance

    def note(self, pose: Pose | None, edges: Glance | None) -> None:
        """Note what is known of the pose and the glance of a frame that moved."""
        self._pose = pose or self._pose
        self._edges = self._edges if edges is None else edges

    def needs_image(self, pose: Pose | None) -> bool:
        """Return whether the image decides, because there is no pose to compare."""
        return self._by_image and self._by_pose(pose) is None

    def _by_pose(self, pose: Pose | None) -> bool | None:
        if pose and self._pose and self._config.stationary_m:
            return near(pose, self._pose, self._config.stationary_m)
        return None
