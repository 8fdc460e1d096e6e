# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses on the ground."""

import math

from convseq_ros.core.types import Pose


def at(x: float, y: float = 0.0, yaw: float = 0.0) -> Pose:
    """Return the pose at a spot, in metres, turned to the left by so many radians."""
    return Pose((float(x), float(y), 0.0), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
