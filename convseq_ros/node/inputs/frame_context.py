# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Data from other topics for an image: its pose and its camera."""

from collections.abc import Sequence

from convseq_ros.config.node_config import NodeConfig
from convseq_ros.core.types import Camera
from convseq_ros.node.inputs.camera_description import CameraDescription
from convseq_ros.node.inputs.camera_mount import Mount
from convseq_ros.node.inputs.listener import ListeningNode
from convseq_ros.node.inputs.odometry_listener import OdometryListener
from convseq_ros.sources.topic_rank import camera_info_beside


class FrameContext:
    """Listens to `odom`, and to `camera_info` of the cameras' `topics`."""

    def __init__(self, node: ListeningNode, config: NodeConfig, topics: Sequence[str]) -> None:
        mount = Mount(node, config.base_frame)
        self.odometry = OdometryListener(node, config.odom_wait_s, mount.odometry_frame())
        infos = {'': 'camera_info'}
        if len(topics) > 1:
            infos = {topic: camera_info_beside(topic) for topic in topics}
        self._cameras = {
            topic: CameraDescription(node, mount, info) for topic, info in infos.items()
        }
        self.camera = next(iter(self._cameras.values()))

    def camera_for(self, topic: str, height: int, width: int) -> Camera | None:
        """Return the camera that takes the images of a topic, of a size in pixels."""
        return self._cameras.get(topic, self.camera).for_image(height, width)
