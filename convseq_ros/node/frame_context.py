# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Data from other topics for an image: its pose, its depth and its camera."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
import threading
from typing import Any

from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Camera, Pose
from convseq_ros.errors import ImageError, one_line
from convseq_ros.node.camera_description import CameraDescription, Mount
from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.node.following_subscription import FollowingSubscription
from convseq_ros.node.listener import ListeningNode
from convseq_ros.node.once import Once
from convseq_ros.sources.depth import decode_depth, Depth, KEPT, nearest
from convseq_ros.sources.pose_track import LONGEST_GAP_NS, pose_from_message, PoseTrack
from convseq_ros.sources.raw_message import IMAGE, RawMessage
from convseq_ros.sources.topic_rank import camera_info_beside
from nav_msgs.msg import Odometry as OdometryMessage
from sensor_msgs.msg import Image

_DEPTH = 200  # messages of odometry that may wait
_KEPT = 20_000
_VAIN_WAITS = 3
_LOST_FRAMES = 20


class Waiting:
    """Makes an image wait for another topic's message, unless three have waited in vain."""

    def __init__(self, wait_s: float) -> None:
        self.wait_s = wait_s
        self.changed = threading.Condition()
        self._in_vain = 0

    def wait_until(self, has_come: Callable[[], bool]) -> None:
        """Wait until a message has come, at most `wait_s`; the caller holds `changed`."""
        if self._in_vain < _VAIN_WAITS and not self.changed.wait_for(has_come, self.wait_s):
            self._in_vain += 1

    def notify(self) -> None:
        """Wake up an image that waits; the caller holds `changed`."""
        self._in_vain = 0
        self.changed.notify()


class OdometryListener:
    """
    Listens to `odom`, returns the pose at the stamp of an image, and counts images without.

    An image often arrives before the odometry of its time, and waits for it: a pose interpolated
    between two messages is the same as offline, an extrapolated one is a guess.
    """

    def __init__(self, node: ListeningNode, wait_s: float) -> None:
        self.frame_id = ''
        self.missing = 0
        self.on_pose: Callable[[int, str], None] = lambda _stamp_ns, _frame_id: None
        self._node = node
        self._track = PoseTrack(kept=_KEPT)
        self._lost_in_a_row = 0
        self.waiting = Waiting(wait_s)
        self._subscription = FollowingSubscription(
            node, OdometryMessage, 'odom', self._on_odometry, _DEPTH
        )

    def follow(self, topic: str) -> None:
        """Listen to another topic, and forget the poses so far."""
        self._subscription.move(topic)
        with self.waiting.changed:
            self._track, self.frame_id = PoseTrack(kept=_KEPT), ''

    def pose_at(self, stamp_ns: int) -> Pose | None:
        """Return the pose at a time, for which this may wait; None if there is none."""
        with self.waiting.changed:
            if self.heard or self._node.count_publishers(self._subscription.topic):
                self.waiting.wait_until(lambda: self._has_reached(stamp_ns))
            pose = self._track.at(stamp_ns)
            self._lost_in_a_row = 0 if pose else self._lost_in_a_row + 1
            last_ns = self._track.last_stamp_ns
        if pose is None and last_ns is not None:
            self.missing += 1
            if self._lost_in_a_row >= _LOST_FRAMES:
                ahead_s = (last_ns - stamp_ns) / 1e9
                self._node.get_logger().warning(
                    f'{self._subscription.topic}: has no pose at the time of the images; its '
                    f'newest stamp is {abs(ahead_s):.1f} s {"later" if ahead_s > 0 else "earlier"}'
                    '; check that it comes and that both clocks agree',
                    once=True,
                )
        return pose

    @property
    def heard(self) -> bool:
        return self._track.last_stamp_ns is not None

    def _has_reached(self, stamp_ns: int) -> bool:
        """Return whether there is nothing more to wait for."""
        last_ns = self._track.last_stamp_ns
        return last_ns is not None and not 0 < stamp_ns - last_ns <= LONGEST_GAP_NS

    def _on_odometry(self, message: Any) -> None:
        stamp_ns = stamp_to_ns(message.header.stamp)
        pose = pose_from_message(message.pose.pose)
        if not stamp_ns or pose is None:
            self._node.get_logger().warning(
                f'{self._subscription.topic}: odometry without a stamp, or with values that are '
                'not a pose, is left out',
                once=True,
            )
            return
        with self.waiting.changed:
            self.frame_id = message.header.frame_id
            self._track.add(stamp_ns, pose)
            self.waiting.notify()
        self.on_pose(stamp_ns, message.header.frame_id)


class DepthImages:
    """Listens to depth images, if a topic is given; counts unreadable and missing ones."""

    def __init__(
        self, node: ListeningNode, topic: str, wait_s: float, reading: ReadingConfig
    ) -> None:
        self.unreadable = self.missing = 0
        self._once, self.reading = Once(node.get_logger()), reading
        self._newest = deque[tuple[int, RawMessage]](maxlen=KEPT)
        self.waiting = Waiting(wait_s)
        self._topic = topic
        if topic:
            FollowingSubscription(node, Image, topic, self._on_depth, KEPT, raw=True)

    def at(self, stamp_ns: int) -> Depth | None:
        """Return the depth image of a time; None if there is none."""
        with self.waiting.changed:
            if not self._newest:
                return None
            self.waiting.wait_until(lambda: self._newest[-1][0] >= stamp_ns)
            message = nearest(self._newest, stamp_ns)
        if message is None:
            self.missing += 1
            return None
        try:
            return decode_depth(message.image(), self.reading)
        except ImageError as error:
            self.unreadable += 1
            self._once.warn(f'{self._topic}: {one_line(error)}; its frame has no depth')
            return None

    def _on_depth(self, cdr: bytes) -> None:
        message = RawMessage(0, IMAGE, cdr)
        with self.waiting.changed:
            self._newest.append((message.header_stamp_ns, message))
            self.waiting.notify()


class FrameContext:
    """Listens to `odom`, and to `camera_info` and depth of the first of the cameras' `topics`."""

    def __init__(
        self,
        node: ListeningNode,
        config: NodeConfig,
        reading: ReadingConfig,
        topics: Sequence[str],
    ) -> None:
        self.odometry = OdometryListener(node, config.odom_wait_s)
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
        """Listen to other topics instead, if 'odom' or 'camera_info' are given."""
        if 'odom' in topics:
            self.odometry.follow(topics['odom'])
        if 'camera_info' in topics:
            self.camera.follow(topics['camera_info'])

    def configure(self, wait_s: float, reading: ReadingConfig) -> None:
        """Use another time to wait, and other limits of what is read, from now on."""
        self.odometry.waiting.wait_s = self.depth.waiting.wait_s = wait_s
        self.depth.reading = reading

    def depth_at(self, topic: str, stamp_ns: int) -> Depth | None:
        """Return the depth image of an image of a topic; may wait for it."""
        is_first = self._cameras.get(topic, self.camera) is self.camera
        return self.depth.at(stamp_ns) if is_first else None

    def camera_for(self, topic: str, height: int, width: int) -> Camera | None:
        """Return the camera that takes the images of a topic, of a size in pixels."""
        return self._cameras.get(topic, self.camera).for_image(height, width)
