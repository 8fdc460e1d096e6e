# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where cameras and odometry of a robot are, by TF."""

from typing import Any

from convseq_ros.core.types import Pose
from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.sources.mount import OdometryFrame, plain_frame, pose_of_transform, told_mount
from rclpy.node import Node
from rclpy.time import Time


class Mount:
    """Poses of cameras on the robot, by TF if tf2_ros is installed; each is looked up once."""

    def __init__(self, node: Node, base_frame: str) -> None:
        self._logger, self._base_frame = node.get_logger(), base_frame
        self._poses: dict[str, Pose | None] = {}
        self._buffer: Any = None
        try:
            from tf2_ros import Buffer, TransformListener
        except ImportError:
            return
        self._buffer = Buffer()
        self._listener = TransformListener(self._buffer, node)

    def of(self, optical_frame: str) -> Pose | None:
        """Return the pose of an optical frame, turned to x along the lens; None if unknown."""
        optical_frame = plain_frame(optical_frame)
        if optical_frame not in self._poses and self._buffer and optical_frame:
            frames = self._base_frame, optical_frame, Time()
            if self._buffer.can_transform(*frames):
                transform = self._buffer.lookup_transform(*frames).transform
                lens = pose_of_transform(transform)
                if lens is not None:
                    mount, line = told_mount(lens, optical_frame, self._base_frame, 'TF')
                    (self._logger.info if mount else self._logger.warning)(line)
                    self._poses[optical_frame] = mount
        return self._poses.get(optical_frame)

    def base_in(self, frame: str) -> Pose | None:
        """Return the pose of the base in a frame; None if they may move, or it is unknown."""
        frames = frame, self._base_frame, Time()
        if not (self._buffer and self._buffer.can_transform(*frames)):
            return None
        stamped = self._buffer.lookup_transform(*frames)
        # A way of static transforms alone has no time.
        is_static = not stamp_to_ns(stamped.header.stamp)
        return pose_of_transform(stamped.transform) if is_static else None

    def odometry_frame(self) -> OdometryFrame:
        """Return what carries poses of odometry to the base."""
        tell = self._logger.info
        return OdometryFrame(self._base_frame, self.base_in, lambda line: tell(f'odom: {line}'))
