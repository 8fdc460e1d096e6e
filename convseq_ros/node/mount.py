# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the camera is on the robot, by TF, where tf2_ros is installed."""

from types import SimpleNamespace
from typing import Any

from convseq_ros.core.rigid import inverse, matrix, pose_of, ROBOT_LENS
from convseq_ros.core.types import Pose
from convseq_ros.sources.pose_track import pose_from_message
from rclpy.node import Node
from rclpy.time import Time


class Mount:
    """Asks TF until it tells, and then no more: a camera is fixed to its robot."""

    def __init__(self, node: Node, base_frame: str) -> None:
        self._node, self._base_frame = node, base_frame
        self._found: dict[str, Pose] = {}
        self._buffer: Any = None
        try:
            from tf2_ros import Buffer, TransformListener
        except ImportError:
            return
        self._buffer = Buffer()
        self._listener = TransformListener(self._buffer, node)

    def of(self, optical_frame: str) -> Pose | None:
        """Return where the camera of a frame (z along the lens) is, x along the lens, if known."""
        if optical_frame not in self._found and self._buffer and optical_frame:
            frames = self._base_frame, optical_frame, Time()
            if self._buffer.can_transform(*frames):
                said = self._buffer.lookup_transform(*frames).transform
                where = {'position': said.translation, 'orientation': said.rotation}
                lens = pose_from_message(SimpleNamespace(**where))
                if lens is not None:
                    self._found[optical_frame] = pose_of(matrix(lens) @ inverse(ROBOT_LENS))
                    position = self._found[optical_frame].position
                    self._node.get_logger().info(
                        f'{optical_frame} is at {position} m in {self._base_frame}, by TF'
                    )
        return self._found.get(optical_frame)
