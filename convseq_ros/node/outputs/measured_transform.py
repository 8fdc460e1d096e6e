# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The transform from a map with poses to odometry, by measured relative poses: no back end."""

import math
from threading import Lock

from convseq_ros.config.node_config import NodeConfig
from convseq_ros.core.rigid import difference, inverse, Matrix, matrix, motion
from convseq_ros.core.types import constants, Frame, Match, PoseEstimate
from convseq_ros.node.outputs.map_to_odom import MapToOdom
import numpy as np
from rclpy.node import Node


@constants
class DRIFT:
    """How the transform follows what is measured; engineering, not studied."""

    of_distance: float = 0.05  # standard deviation of odometry, as a share of the distance, ...
    rad_per_m: float = 0.005
    gate: float = 22.5  # squared error of a measurement, in variances: 99.9 % quantile, 6 numbers
    most_outside: int = 3  # measurements in a row after which the newest one is right


class MeasuredTransform:
    """
    A Kalman filter of the pose of odometry in the map.

    It is published with each message of odometry, once a pose was measured. `update` is called in
    the worker's thread.
    """

    def __init__(self, node: Node, config: NodeConfig) -> None:
        self._output = MapToOdom(node, config.map_frame, True)
        self._lock = Lock()
        self._moved: Matrix | None = None  # (4, 4), pose of the frame of odometry in the map
        self._covariance = np.zeros((6, 6))  # of the base, in its axes; x, y, z, turns
        self._of_map = 0.0, config.heading_sigma_rad
        self._last = self._newest = np.eye(4)  # base in odometry, at the last measurement, and now
        self._off = np.zeros(6)  # of the newest measurement, if it was outside
        self._measured_ns, self._newest_ns, self._outside = 0, 0, 0

    def update(
        self, frame: Frame, match: Match, estimate: PoseEstimate | None, of_map_m: float
    ) -> None:
        """
        Take in a frame, and its match if its pose was measured in metres, by odometry.

        `of_map_m` is the standard deviation of positions in the map.
        """
        self._newest_ns, self._of_map = frame.stamp_ns, (of_map_m, self._of_map[1])
        if frame.pose:
            self._newest = matrix(frame.pose)
        relative, pose = match.relative_pose, frame.pose
        if estimate is None or relative is None or relative.pose is None or pose is None:
            return
        base, goal = matrix(pose), matrix(estimate.pose)
        to_base = np.kron(np.eye(2), matrix(relative.pose)[:3, :3].T)
        noise = to_base @ relative.covariance @ to_base.T
        with self._lock:
            is_back = frame.stamp_ns < self._measured_ns
            self._measured_ns = frame.stamp_ns
            if self._moved is None or is_back or self._outside >= DRIFT.most_outside:
                self._set(goal, base, noise)
                return
            before = self._covariance + self._drift(base)
            expected = self._moved @ base
            off = difference(expected, goal)
            total = before + noise
            if off @ np.linalg.solve(total, off) > DRIFT.gate:
                self._outside, self._off = self._outside + 1, off
                return
            gain = before @ np.linalg.inv(total)
            self._set(expected @ motion(gain @ off), base, before - gain @ before)

    def _set(self, goal: Matrix, base: Matrix, covariance: Matrix) -> None:
        self._moved, self._last = goal @ inverse(base), base
        self._covariance, self._outside, self._off = covariance, 0, np.zeros(6)

    def _drift(self, base: Matrix) -> Matrix:
        """Return the covariance (6, 6) of odometry since the last measurement."""
        distance_m = math.dist(base[:3, 3], self._last[:3, 3])
        return np.diag((distance_m * np.repeat((DRIFT.of_distance, DRIFT.rad_per_m), 3)) ** 2)

    def on_odometry(self, stamp_ns: int, frame_id: str) -> None:
        """Broadcast the transform at the stamp of a pose of odometry, if it is known."""
        with self._lock:
            moved = self._moved
        if moved is not None:
            self._output.publish(stamp_ns, frame_id, moved)

    @property
    def problem(self) -> str:
        """Why the transform is not broadcast, if another node does it."""
        return self._output.problem

    @property
    def values(self) -> dict[str, float]:
        """
        Its age in seconds and its standard deviations now, for diagnostics.

        They are of the measurement, what was driven since, the map's poses, and of what a newer
        measurement contradicts; infinite once time went back.
        """
        if self._moved is None:
            return {}
        with self._lock:
            now = self._covariance + self._drift(self._newest)
            variances = now.diagonal() + np.repeat(np.square(self._of_map), 3) + self._off**2
            metres, radians = (
                math.sqrt(float(variances[part].max())) for part in (slice(0, 3), slice(3, 6))
            )
            if self._newest_ns < self._measured_ns:
                metres = radians = math.inf
            newest_ns = max(self._output.stamp_ns, self._newest_ns)
            age_s = max(0.0, (newest_ns - self._measured_ns) / 1e9)
        return {
            'map_to_odom_age_s': age_s,
            'map_to_odom_sigma_m': metres,
            'map_to_odom_sigma_rad': radians,
        }
