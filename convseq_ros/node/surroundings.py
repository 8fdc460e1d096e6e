# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What other topics report of an image: where it was taken, how deep, and by which camera."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from convseq_ros.core.rigid import inverse, matrix, pose_of, ROBOT_LENS
from convseq_ros.core.types import Camera, Pose
from convseq_ros.errors import SourceError
from convseq_ros.node.odometry import DepthImages, Odometry
from convseq_ros.node.topic_finder import camera_info_beside
from convseq_ros.node.topics import FollowingSubscription
from convseq_ros.node_config import NodeConfig
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources.camera_info import camera_from_info, fitted
from convseq_ros.sources.depth import Depth
from convseq_ros.sources.pose_track import pose_from_message
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo

_DEPTH = 10


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
        infos = {'': 'camera_info'}
        if len(topics) > 1:
            infos = {topic: camera_info_beside(topic) for topic in topics}
        self._cameras = {
            topic: CameraDescription(node, mount, info) for topic, info in infos.items()
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


class CameraDescription:
    """
    Listens to a topic of camera_info; the last message holds.

    `mount` finds where its frame is on the robot.
    """

    def __init__(self, node: Node, mount: 'Mount', topic: str = 'camera_info') -> None:
        self._camera: Camera | None = None
        self._mount, self._frame_id = mount, ''
        self._logger = node.get_logger()
        self._subscription = FollowingSubscription(
            node, CameraInfo, topic, self._on_camera_info, _DEPTH
        )
        self.follow = self._subscription.move

    @property
    def known(self) -> bool:
        """Whether the camera is calibrated."""
        return self._camera is not None

    def for_image(self, height: int, width: int) -> Camera | None:
        """Return the camera as it describes images of a size, in pixels; None if unknown."""
        if (camera := self._camera) is None:
            return None
        return replace(fitted(camera, height, width), mount=self._mount.of(self._frame_id))

    def _on_camera_info(self, message: Any) -> None:
        try:
            self._camera = camera_from_info(message)
            self._frame_id = message.header.frame_id
        except SourceError as error:
            self._camera = None
            self._logger.warning(f'{self._subscription.topic}: {error}', once=True)


class Mount:
    """Asks TF where cameras are, where tf2_ros is installed: each once, for it is fixed."""

    def __init__(self, node: Node, base_frame: str) -> None:
        self._logger, self._base_frame = node.get_logger(), base_frame
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
                found = self._buffer.lookup_transform(*frames).transform
                where = {'position': found.translation, 'orientation': found.rotation}
                lens = pose_from_message(SimpleNamespace(**where))
                if lens is not None:
                    self._found[optical_frame] = pose_of(matrix(lens) @ inverse(ROBOT_LENS))
                    position = self._found[optical_frame].position
                    self._logger.info(
                        f'{optical_frame} is at {position} m in {self._base_frame}, by TF'
                    )
        return self._found.get(optical_frame)
