# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What other topics say of an image: where it was taken, and by which camera."""

from collections.abc import Mapping, Sequence

from convseq_ros.core.types import Camera, Pose
from convseq_ros.node.camera_description import CameraDescription
from convseq_ros.node.depth_images import DepthImages
from convseq_ros.node.mount import Mount
from convseq_ros.node.odometry import Odometry
from convseq_ros.node.topic_finder import camera_info_beside
from convseq_ros.node_config import NodeConfig
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources.depth import Depth
from rclpy.node import Node


class Surroundings:
    """
    Listens to `odom`, `camera_info` and a topic of depth; all are optional.

    `topics` are those of images, resolved, if there are several cameras: `camera` and `depth` are
    then of the first.
    """

    def __init__(
        self, node: Node, config: NodeConfig, reading: ReadingConfig, topics: Sequence[str]
    ) -> None:
        self.odometry = Odometry(node, config.odom_wait_s)
        self.depth = DepthImages(node, config.depth_topic, config.odom_wait_s, reading)
        mount = Mount(node, config.base_frame)
        if len(topics) < 2:
            self._cameras = {'': CameraDescription(node, mount)}
        else:
            self._cameras = {
                topic: CameraDescription(node, mount, camera_info_beside(topic))
                for topic in topics
            }
        self.camera = next(iter(self._cameras.values()))

    def follow(self, topics: Mapping[str, str]) -> None:
        """Listen to other topics instead, those of 'odom' and 'camera_info' that are given."""
        if 'odom' in topics:
            self.odometry.follow(topics['odom'])
        if 'camera_info' in topics:
            self.camera.follow(topics['camera_info'])

    def pose_at(self, stamp_ns: int) -> Pose | None:
        """Return where an image was taken; may wait for odometry."""
        return self.odometry.pose_at(stamp_ns)

    def depth_at(self, topic: str, stamp_ns: int) -> Depth | None:
        """Return the depth image of an image of a topic; may wait for it."""
        is_own = self._cameras.get(topic, self.camera) is self.camera
        return self.depth.at(stamp_ns) if is_own else None

    def camera_for(self, topic: str, height: int, width: int) -> Camera | None:
        """Return the camera that takes the images of a topic, of a size in pixels."""
        return self._cameras.get(topic, self.camera).for_image(height, width)
