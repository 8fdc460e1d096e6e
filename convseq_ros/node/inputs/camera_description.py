# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The calibration of a camera, by camera_info."""

from dataclasses import replace
from typing import Any

from convseq_ros.core.types import Camera
from convseq_ros.errors import one_line, SourceError
from convseq_ros.node.inputs.camera_mount import Mount
from convseq_ros.node.inputs.following_subscription import FollowingSubscription
from convseq_ros.node.inputs.listener import ListeningNode
from convseq_ros.node.inputs.once import Once
from convseq_ros.sources.camera_info import camera_from_info, correction, fitted, misfit
from sensor_msgs.msg import CameraInfo

_INFO_DEPTH = 10  # messages of camera_info that may wait


class CameraDescription:
    """Listens to camera_info and keeps the last message; `mount` returns the camera's pose."""

    def __init__(self, node: ListeningNode, mount: Mount, topic: str = 'camera_info') -> None:
        self._camera: Camera | None = None
        self._mount, self._frame_id = mount, ''
        self._once = Once(node.get_logger())
        self._subscription = FollowingSubscription(
            node, CameraInfo, topic, self._on_camera_info, _INFO_DEPTH, latched=True
        )

    @property
    def is_calibrated(self) -> bool:
        return self._camera is not None

    def for_image(self, height: int, width: int) -> Camera | None:
        """Return the camera for images of a size in pixels; None if there is none for them."""
        if (known := self._camera) is None:
            return None
        if camera := fitted(known, height, width):
            return replace(camera, mount=self._mount.of(self._frame_id))
        self._once.warn(f'{self._subscription.topic}: {misfit(known, height, width)}')
        return None

    def _on_camera_info(self, message: Any) -> None:
        try:
            self._camera = camera_from_info(message)
            self._frame_id = message.header.frame_id
            if line := correction(message, self._camera):
                self._once.warn(f'{self._subscription.topic}: {line}')
        except SourceError as error:
            self._camera = None
            self._once.warn(f'{self._subscription.topic}: {one_line(error)}')
