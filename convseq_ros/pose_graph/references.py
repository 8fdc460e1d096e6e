# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The places that closures refer to: of a drive in the graph, or in the frame of a map."""

from collections.abc import Sequence
from dataclasses import replace

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.rigid import Matrix
from convseq_ros.pose_graph.closures import Closure
from convseq_ros.pose_graph.odometry import Odometry
import numpy as np

Place = tuple[int, Matrix]  # a keyframe's node, over all drives from 1 on, and the pose since it
MAP = 0  # node at the origin of the map, from which absolute poses are measured

_MOST_WAITING = 1000  # absolute poses that wait for their closure


class References:
    """Finds the references of closures, and keeps poses for those that are in no drive."""

    def __init__(self, config: PoseGraphConfig) -> None:
        self._config, self._absolute = config, dict[int, tuple[Matrix, Matrix]]()

    def add_pose(self, query_ns: int, pose: Matrix, covariance: Matrix) -> None:
        """Add a pose in the frame of the map, for a closure whose place is not in the graph."""
        self._absolute[query_ns] = pose, covariance
        if len(self._absolute) > _MOST_WAITING:
            del self._absolute[next(iter(self._absolute))]

    def of(self, closure: Closure, drives: Sequence[Odometry]) -> tuple[Closure, Place | None]:
        """Return a closure as it is used, and its reference; None if it is not known."""
        reference = _in_drives(closure, drives)
        # One without a session is of this drive, or comes again, with its session.
        if reference is None and closure.session and closure.query_ns in self._absolute:
            moved, covariance = self._absolute[closure.query_ns]
            return replace(closure, moved=moved, covariance=covariance), (MAP, np.eye(4))
        if not closure.is_measured:
            moved, covariance = closure.moved.copy(), closure.covariance.copy()
            moved[:3, 3] = covariance[:3] = covariance[:, :3] = 0
            covariance[:3, :3] = np.eye(3) * self._config.closure_sigma_m**2
            closure = replace(closure, moved=moved, covariance=covariance)
        return closure, reference


def _in_drives(closure: Closure, drives: Sequence[Odometry]) -> Place | None:
    """Return the reference of a closure in one of the drives, of which the last is running."""
    for drive in drives:
        is_running = drive is drives[-1] and not closure.session
        if is_running or closure.session in drive.sessions:
            return drive.place(closure.reference_ns)
    return None
