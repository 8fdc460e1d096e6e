# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Closures and poses that messages tell a pose graph; pure functions, None for what is none."""

from typing import Any

from convseq_ros.core.rigid import Matrix, matrix
from convseq_ros.core.types import UNKNOWN_M2
from convseq_ros.pose_graph.closures import Closure, usable
from convseq_ros.sources.pose_track import pose_from_message
import numpy as np

_SAME_PLACE = np.diag([UNKNOWN_M2] * 3 + [0.0] * 3)


def closure_of(message: Any, sigma_rad: float) -> tuple[str, Closure] | None:
    """
    Return the closure of `~/closure_odometry`, and the session of its query, empty if unknown.

    `sigma_rad` is the standard deviation of a turn that was not measured.
    """
    session, reference_ns = _place_of(message.header.frame_id)
    own, query_ns = _place_of(message.child_frame_id)
    found = uncertain_pose(message)
    if not (reference_ns and query_ns and found):
        return None
    pose, covariance = found
    session = '' if session == own else session
    return own, Closure(query_ns, reference_ns, pose, usable(covariance, sigma_rad), session)


def closure_of_pair(message: Any, sigma_rad: float) -> Closure | None:
    """Return the closure of `~/loop_closure`, two times in seconds: they are of the same place."""
    if len(message.data) != 2 or not np.isfinite(message.data).all():
        return None
    query_ns, reference_ns = (round(seconds * 1e9) for seconds in message.data)
    turn = np.diag([0.0] * 3 + [sigma_rad**2] * 3)
    return Closure(query_ns, reference_ns, np.eye(4), _SAME_PLACE + turn)


def uncertain_pose(message: Any) -> tuple[Matrix, Matrix] | None:
    """Return the pose (4, 4) and its covariance (6, 6), finite and without negative variances."""
    pose = pose_from_message(message.pose.pose)
    covariance = np.reshape(message.pose.covariance, (6, 6))
    if pose is None or not np.isfinite(covariance).all():
        return None
    return (matrix(pose), covariance) if np.linalg.eigvalsh(covariance).min() >= -1e-6 else None


def _place_of(name: str) -> tuple[str, int]:
    """Return the session and the stamp of `session/stamp_ns`; 0 if it has no stamp."""
    session, _, stamp = name.rpartition('/')
    return session, int(stamp) if stamp.isdecimal() else 0
