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
_PATIENCE_S = 0.05
_UNHEARD_FRAMES = 20


class Odometry:
    """
    Listens to `odom` and tells the pose at the stamp of an image.

    An image often comes before the odometry of its moment. It waits for it, in the worker's
    thread, but for 50 ms at most, and only while odometry comes at all: a pose between two of the
    odometry is what an offline run finds, one that is extrapolated is a guess.

    Parameters
    ----------
    node : Node
        Whose relative topic `odom` it is.

    Attributes
    ----------
    frame_id : str
        The frame in which the odometry is given; empty before it is heard.
    missing : int
        Images whose pose it could not tell since it was heard for the first time.

    """

    def __init__(self, node: Node) -> None:
        self.frame_id = ''
        self.missing = 0
        self._node = node
        self._topic = node.resolve_topic_name('odom')
        self._track = PoseTrack(kept=_KEPT)
        self._unheard = 0
        self._changed = threading.Condition()
        FollowingSubscription(node, OdometryMessage, 'odom', self._on_odometry, _DEPTH)

    def pose_at(self, stamp_ns: int) -> Pose | None:
        """Return the pose at a time; None if odometry does not tell."""
        with self._changed:
            if self._worth_waiting():
                self._changed.wait_for(lambda: self._has_reached(stamp_ns), _PATIENCE_S)
            pose = self._track.at(stamp_ns)
            if pose is None and self._track.last_stamp_ns is not None:
                self.missing += 1
        return pose

    @property
    def heard(self) -> bool:
        """Whether there was any."""
        return self._track.last_stamp_ns is not None

    def _worth_waiting(self) -> bool:
        if self.heard:
            return True
        # Somebody who only announces odometry shall not slow down every frame.
        self._unheard += 1
        return self._unheard <= _UNHEARD_FRAMES and self._node.count_publishers(self._topic) > 0

    def _has_reached(self, stamp_ns: int) -> bool:
        """Return whether there is nothing more to wait for."""
        last_ns = self._track.last_stamp_ns
        return last_ns is not None and not 0 < stamp_ns - last_ns <= LONGEST_GAP_NS

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
            self._changed.notify()
