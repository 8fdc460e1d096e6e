# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the camera was when an image was taken, by odometry."""

import threading
from typing import Any

from convseq_ros.core.types import Pose
from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.node.subscription import FollowingSubscription
from convseq_ros.sources.pose_track import LONGEST_GAP_NS, pose_from_message, PoseTrack
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.node import Node

_DEPTH = 200
_KEPT = 20_000
_UNHEARD_FRAMES = 20
_VAIN_WAITS = 3
_LOST_FRAMES = 20
_LOG_PERIOD_S = 10.0


class Odometry:
    """
    Listens to `odom` and tells the pose at the stamp of an image.

    An image often comes before the odometry of its moment. It waits for it, in the worker's
    thread, but for `wait_s` only, and only while odometry comes at all: a pose between two of the
    odometry is what an offline run finds, one that is extrapolated is a guess. After three images
    that waited in vain, none waits before odometry comes again.

    `frame_id` is the frame in which the odometry is given, empty before it is heard; `missing`
    counts images whose pose it could not tell since then.
    """

    def __init__(self, node: Node, wait_s: float) -> None:
        self.wait_s = wait_s
        self.frame_id = ''
        self.missing = 0
        self._node = node
        self._topic = node.resolve_topic_name('odom')
        self._track = PoseTrack(kept=_KEPT)
        self._unheard = self._waited_in_vain = self._lost_in_a_row = 0
        self._changed = threading.Condition()
        self._subscription = FollowingSubscription(
            node, OdometryMessage, 'odom', self._on_odometry, _DEPTH
        )

    def follow(self, topic: str) -> None:
        """Listen to another topic instead."""
        self._topic = topic
        self._subscription.move(topic)

    def pose_at(self, stamp_ns: int) -> Pose | None:
        """Return the pose at a time; None if odometry does not tell."""
        with self._changed:
            if self._worth_waiting() and not self._changed.wait_for(
                lambda: self._has_reached(stamp_ns), self.wait_s
            ):
                self._waited_in_vain += 1
            pose = self._track.at(stamp_ns)
            self._lost_in_a_row = 0 if pose else self._lost_in_a_row + 1
            last_ns = self._track.last_stamp_ns
        if pose is None and last_ns is not None:
            self.missing += 1
            if self._lost_in_a_row >= _LOST_FRAMES:
                self._tell(last_ns - stamp_ns)
        return pose

    @property
    def heard(self) -> bool:
        """Whether there was any."""
        return self._track.last_stamp_ns is not None

    def _worth_waiting(self) -> bool:
        if self.heard:
            return self._waited_in_vain < _VAIN_WAITS
        # Somebody who only announces odometry shall not slow down every frame.
        self._unheard += 1
        return self._unheard <= _UNHEARD_FRAMES and self._node.count_publishers(self._topic) > 0

    def _has_reached(self, stamp_ns: int) -> bool:
        """Return whether there is nothing more to wait for."""
        last_ns = self._track.last_stamp_ns
        return last_ns is not None and not 0 < stamp_ns - last_ns <= LONGEST_GAP_NS

    def _tell(self, ahead_ns: int) -> None:
        """Say how far the newest odometry is from an image."""
        self._node.get_logger().warning(
            f'{self._topic}: tells no pose at the time of the images; its newest stamp is '
            f'{abs(ahead_ns) / 1e9:.1f} s {"later" if ahead_ns > 0 else "earlier"}; check that it '
            'comes and that both clocks agree',
            throttle_duration_sec=_LOG_PERIOD_S,
        )

    def _on_odometry(self, message: Any) -> None:
        stamp_ns = stamp_to_ns(message.header.stamp)
        pose = pose_from_message(message.pose.pose)
        if not stamp_ns or pose is None:
            self._node.get_logger().warning(
                f'{self._topic}: odometry without a stamp, or with values that are '
                'not a pose, is left out',
                once=True,
            )
            return
        with self._changed:
            self.frame_id = message.header.frame_id
            self._track.add(stamp_ns, pose)
            self._waited_in_vain = 0
            self._changed.notify()
