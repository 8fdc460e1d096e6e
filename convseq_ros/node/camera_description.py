# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which camera takes the images, by its camera_info."""

from dataclasses import replace
from typing import Any

from convseq_ros.core.types import Camera
from convseq_ros.errors import SourceError
from convseq_ros.node.mount import Mount
from convseq_ros.node.subscription import FollowingSubscription
from convseq_ros.sources.camera_info import camera_from_info, fitted
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo

_DEPTH = 10


class CameraDescription:
    """
    Listens to `camera_info`, or another topic; what it said last holds.

    `mount` tells where its frame is on the robot.
    """

    def __init__(self, node: Node, mount: Mount, topic: str = 'camera_info') -> None:
        self._camera: Camera | None = None
        self._mount, self._frame_id = mount, ''
        self._logger = node.get_logger()
        self._subscription = FollowingSubscription(
            node, CameraInfo, topic, self._on_camera_info, _DEPTH
        )

    def follow(self, topic: str) -> None:
        """Listen to another topic instead."""
        self._subscription.move(topic)

    @property
    def known(self) -> bool:
        """Whether the camera is calibrated."""
        return self._camera is not None

    def for_image(self, height: int, width: int) -> Camera | None:
        """Return the camera as it describes images of a size, in pixels; None if unknown."""
        camera = self._camera
        if camera is None:
            return None
        return replace(fitted(camera, height, width), mount=self._mount.of(self._frame_id))

    def _on_camera_info(self, message: Any) -> None:
        try:
            self._camera = camera_from_info(message)
            self._frame_id = message.header.frame_id
        except SourceError as error:
            self._camera = None
            self._logger.warning(f'{self._subscription.topic}: {error}', once=True)
