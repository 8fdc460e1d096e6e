# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cameras of a robot: their calibrations by camera_info, and where they are by TF."""

from dataclasses import replace
from typing import Any

from convseq_ros.core.types import Camera, Pose
from convseq_ros.errors import one_line, SourceError
from convseq_ros.node.following_subscription import FollowingSubscription
from convseq_ros.node.listener import ListeningNode
from convseq_ros.node.once import Once
from convseq_ros.sources.camera_info import camera_from_info, correction, fitted
from convseq_ros.sources.mount import as_parameter, mount_of, pose_of_transform
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo

_INFO_DEPTH = 10  # messages of camera_info that may wait


class CameraDescription:
    """Listens to camera_info and keeps the last message; `mount` returns the camera's pose."""

    def __init__(self, node: ListeningNode, mount: 'Mount', topic: str = 'camera_info') -> None:
        self._camera: Camera | None = None
        self._mount, self._frame_id = mount, ''
        self._once = Once(node.get_logger())
        self._subscription = FollowingSubscription(
            node, CameraInfo, topic, self._on_camera_info, _INFO_DEPTH, latched=True
        )

    def follow(self, topic: str) -> None:
        """Listen to another topic, and forget the camera so far."""
        self._camera = None
        self._subscription.move(topic)

    @property
    def is_calibrated(self) -> bool:
        return self._camera is not None

    def for_image(self, height: int, width: int) -> Camera | None:
        """Return the camera for images of a size in pixels; None if it is not calibrated."""
        if (camera := self._camera) is None:
            return None
        return replace(fitted(camera, height, width), mount=self._mount.of(self._frame_id))

    def _on_camera_info(self, message: Any) -> None:
        try:
            self._camera = camera_from_info(message)
            self._frame_id = message.header.frame_id
            if line := correction(message, self._camera):
                self._once.warn(f'{self._subscription.topic}: {line}')
        except SourceError as error:
            self._camera = None
            self._once.warn(f'{self._subscription.topic}: {one_line(error)}')


class Mount:
    """Poses of cameras on the robot, by TF if tf2_ros is installed; each is looked up once."""

    def __init__(self, node: Node, base_frame: str) -> None:
        self._logger, self._base_frame = node.get_logger(), base_frame
        self._poses: dict[str, Pose] = {}
        self._buffer: Any = None
        try:
            from tf2_ros import Buffer, TransformListener
        except ImportError:
            return
        self._buffer = Buffer()
        self._listener = TransformListener(self._buffer, node)

    def of(self, optical_frame: str) -> Pose | None:
        """Return the pose of an optical frame, turned to x along the lens; None if unknown."""
        if optical_frame not in self._poses and self._buffer and optical_frame:
            frames = self._base_frame, optical_frame, Time()
            if self._buffer.can_transform(*frames):
                transform = self._buffer.lookup_transform(*frames).transform
                lens = pose_of_transform(transform)
                if lens is not None:
                    self._poses[optical_frame] = mount_of(lens)
                    self._logger.info(
                        f'camera_to_base is "{as_parameter(self._poses[optical_frame])}", as TF '
                        f'places {optical_frame} in {self._base_frame}'
                    )
        return self._poses.get(optical_frame)
