# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What other topics say of an image: where it was taken, and by which camera."""

from collections.abc import Mapping, Sequence

from convseq_ros.core.types import Camera, Pose
from convseq_ros.node.camera_description import CameraDescription
from convseq_ros.node.mount import Mount
from convseq_ros.node.odometry import Odometry
from convseq_ros.node.topic_finder import camera_info_beside
from rclpy.node import Node


class Surroundings:
    """
    Listens to `odom` and `camera_info`; both are optional.

    Parameters
    ----------
    node : Node
        Whose relative topics they are.
    odom_wait_s : float
        How long an image may wait for odometry, seconds.
    base_frame : str
        Of the robot, in which TF tells where the camera is.

    Attributes
    ----------
    odometry : Odometry
    camera : CameraDescription
        Of the only camera, or the first.

    """

    def __init__(
        self, node: Node, odom_wait_s: float, base_frame: str, topics: Sequence[str] = ()
    ) -> None:
        self.odometry = Odometry(node, odom_wait_s)
        mount = Mount(node, base_frame)
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

    def camera_for(self, topic: str, height: int, width: int) -> Camera | None:
        """Return the camera that takes the images of a topic, of a size in pixels."""
        return self._cameras.get(topic, self.camera).for_image(height, width)
