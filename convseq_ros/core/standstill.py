# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the robot stands still: what it sees then is nothing new."""

import math

from convseq_ros.config import MotionConfig
from convseq_ros.core.similarity.regional import similarity
from convseq_ros.core.types import Descriptor, Pose

_TURN_RAD = math.tau / 20


class Standstill:
    """
    Compares each frame with the last that moved, so that creeping adds up.

    Parameters
    ----------
    config : MotionConfig
        From where on it is motion.
    by_image : bool
        Whether images are asked where there is no odometry.

    """

    def __init__(self, config: MotionConfig, by_image: bool) -> None:
        self._config = config
        self._by_image = by_image and config.stationary_overlap < 1.0
        self._pose: Pose | None = None
        self._descriptor: Descriptor | None = None

    def reset(self) -> None:
        """Forget the last frame that moved."""
        self._pose = self._descriptor = None

    def holds(self, descriptor: Descriptor, pose: Pose | None) -> bool:
        """
        Return whether the robot has not moved since the last frame for which this was False.

        Parameters
        ----------
        descriptor : Descriptor
            Of the newest frame; one that shows nothing counts as motion.
        pose : Pose, optional
            Where odometry says that it was taken.

        """
        if not descriptor.informative:
            return False
        if pose and self._pose and self._config.stationary_m:
            still = near(pose, self._pose, self._config.stationary_m)
        else:
            still = self._looks_alike(descriptor)
        if not still:
            self._pose, self._descriptor = pose, descriptor
        return still

    def _looks_alike(self, descriptor: Descriptor) -> bool:
        last = self._descriptor
        if not self._by_image or last is None:
            return False
        return similarity(descriptor, last) > self._config.stationary_overlap


def near(pose: Pose, other: Pose, distance_m: float) -> bool:
    """Return whether a pose is nearer than this to another, and turned by less than a 20th."""
    cosine = abs(sum(a * b for a, b in zip(pose.orientation, other.orientation, strict=True)))
    turn_rad = 2 * math.acos(min(cosine, 1.0))
    return math.dist(pose.position, other.position) < distance_m and turn_rad < _TURN_RAD
