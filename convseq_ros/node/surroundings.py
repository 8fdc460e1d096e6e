# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What other topics say of an image: where it was taken, and by which camera."""

from collections.abc import Mapping

from convseq_ros.core.types import Camera, Pose
from convseq_ros.node.camera_description import CameraDescription
from convseq_ros.node.depth_images import DepthImages
from convseq_ros.node.mount import Mount
from convseq_ros.node.odometry import Odometry
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources.depth import Depth
from rclpy.node import Node


class Surroundings:
    """
    Listens to `odom`, `camera_info` and a topic of depth; all are optional.

    Parameters
    ----------
    node : Node
        Whose relative topics they are.
    odom_wait_s : float
        How long an image may wait for odometry, or depth, seconds.
    base_frame : str
        Of the robot, in which TF tells where the camera is.
    depth_topic : str, optional
        Of depth images; empty for none.
    reading : ReadingConfig, optional
        What is too large.

    Attributes
    ----------
    odometry : Odometry
    camera : CameraDescription
    depth : DepthImages

    """

    def __init__(
        self,
        node: Node,
        odom_wait_s: float,
        base_frame: str,
        depth_topic: str = '',
        reading: ReadingConfig = ReadingConfig(),
    ) -> None:
        self.odometry = Odometry(node, odom_wait_s)
        self.depth = DepthImages(node, depth_topic, odom_wait_s, reading)
        self.camera = CameraDescription(node, Mount(node, base_frame))

    def follow(self, topics: Mapping[str, str]) -> None:
        """Listen to other topics instead, those of 'odom' and 'camera_info' that are given."""
        if 'odom' in topics:
            self.odometry.follow(topics['odom'])
        if 'camera_info' in topics:
            self.camera.follow(topics['camera_info'])

    def pose_at(self, stamp_ns: int) -> Pose | None:
        """Return where an image was taken; may wait for odometry."""
        return self.odometry.pose_at(stamp_ns)

    def depth_at(self, stamp_ns: int) -> Depth | None:
        """Return the depth image of an image; may wait for it."""
        return self.depth.at(stamp_ns)

    def camera_for(self, height: int, width: int) -> Camera | None:
        """Return the camera that takes images of a size, in pixels."""
        return self.camera.for_image(height, width)
