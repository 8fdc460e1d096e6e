# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What closures could do at best: those of the truth, and how far both visits lie apart."""

from collections.abc import Mapping, Sequence
import math

from graph import Closure, Odometry, Pose
import gtsam
import numpy as np
import numpy.typing as npt

_APART_NS, _SAME_M, _SAME_RAD = 30_000_000_000, 5.0, 0.5
_EXACT = tuple(np.diag(np.square((1e-3, 1e-3, 1e-4))).ravel().tolist())


def perfect_closures(stamps_ns: Sequence[int], poses: Mapping[int, Pose]) -> list[Closure]:
    """
    Return the true relative pose of every keyframe where the robot has been 30 s before or more.

    That is within 5 m and 0.5 rad; the reference is the nearest such keyframe.

    Parameters
    ----------
    stamps_ns : sequence of int
        Of the keyframes, ascending.
    poses : mapping of int to Pose
        Where the robot really was at these times.

    """
    found = []
    for stamp_ns in stamps_ns:
        here = poses[stamp_ns]
        known = [
            known_ns
            for known_ns in stamps_ns
            if stamp_ns - known_ns >= _APART_NS
            and math.dist(poses[known_ns][:2], here[:2]) <= _SAME_M
            and abs(math.remainder(poses[known_ns].yaw - here.yaw, 2 * math.pi)) <= _SAME_RAD
        ]
        if known:
            nearest_ns = min(known, key=lambda at: math.dist(poses[at][:2], here[:2]))
            apart = _between(poses[nearest_ns], here)
            found.append(Closure(stamp_ns, nearest_ns, None, apart, _EXACT))
    return found


def between_visits_m(
    path: npt.NDArray[np.float64], stamps_ns: Sequence[int], closures: Sequence[Closure]
) -> float:
    """
    Return how wrong a path is about where both visits of a place lie to each other, metres.

    Parameters
    ----------
    path : ndarray of float64, shape (N, 3)
        x, y, yaw at the keyframes.
    stamps_ns : sequence of int
        Of the keyframes.
    closures : sequence of Closure
        The perfect ones, at least one.

    Returns
    -------
    float
        Root mean square over all of these.

    """
    at = {stamp_ns: Pose(*pose) for stamp_ns, pose in zip(stamps_ns, path.tolist(), strict=True)}
    off = [
        math.dist(_between(at[one.reference_ns], at[one.query_ns])[:2], one.measured[:2])
        for one in closures
        if one.measured
    ]
    return float(np.sqrt(np.mean(np.square(off))))


def with_right_length(odometry: Odometry, scale: float) -> Odometry:
    """Return the keyframes of odometry whose way is no longer too long by a share of it."""
    right = Odometry(0.0)
    for stamp_ns, pose in zip(odometry.stamps_ns, odometry.keyframes, strict=True):
        right.add(stamp_ns, Pose(pose.x / (1 + scale), pose.y / (1 + scale), pose.yaw))
    return right


def _between(before: Pose, after: Pose) -> Pose:
    apart = gtsam.Pose2(*before).between(gtsam.Pose2(*after))
    return Pose(apart.x(), apart.y(), apart.theta())
