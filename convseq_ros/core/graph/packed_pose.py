# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Relative poses as bytes, in memory and in a map's file: a third of the size of the objects."""

import math

from convseq_ros.core.rigid import vector
from convseq_ros.core.types import RelativePose
import numpy as np

NUMBERS = 33  # of a relative pose: 4 orientation, 3 position, 3 direction, 21 covariance, 2 more
_UPPER = np.triu_indices(6)  # the stored half of a covariance


def packed_pose(pose: RelativePose) -> bytes:
    """Return a relative pose as 33 float64, NaN for an unknown position or direction."""
    unknown = (math.nan,) * 3
    numbers = *pose.orientation, *(pose.position_m or unknown), *(pose.direction or unknown)
    return np.array(
        [*numbers, *pose.covariance[_UPPER], pose.inliers, pose.explains], '<f8'
    ).tobytes()


def unpacked_pose(packed: bytes) -> RelativePose:
    """Return a relative pose from what `packed_pose` returns."""
    numbers = np.frombuffer(packed, '<f8')
    x, y, z, w = numbers[:4].tolist()
    covariance = np.zeros((6, 6))
    covariance[_UPPER] = numbers[10:31]
    covariance.T[_UPPER] = numbers[10:31]
    position, direction = (
        vector(row) if np.isfinite(row).all() else None for row in numbers[4:10].reshape(2, 3)
    )
    inliers, explains = int(numbers[31]), bool(numbers[32])
    return RelativePose((x, y, z, w), position, direction, covariance, inliers, explains)
