# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of the robot's base, by the messages of odometry."""

from collections.abc import Callable
from typing import Any

from convseq_ros.core.types import Pose
from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.node.inputs.following_subscription import FollowingSubscription
from convseq_ros.node.inputs.listener import ListeningNode
from convseq_ros.sources.mount import OdometryFrame, plain_frame
from convseq_ros.sources.pose_track import odometry_from_message
from nav_msgs.msg import Odometry

_TF_WAIT_NS = 3_000_000_000  # in which TF may still come


class OdometrySubscription(FollowingSubscription):
    """
    Hears `odom`, and calls `on_pose` with the stamp, the pose of the base and its frame.

    `frame` carries poses to the base. What has no stamp, is no pose, or cannot be carried is left
    out, with one line; `depth` messages may wait.
    """

    def __init__(
        self,
        node: ListeningNode,
        frame: OdometryFrame,
        on_pose: Callable[[int, Pose, str], None],
        depth: int,
    ) -> None:
        self._logger, self._frame, self._on_pose = node.get_logger(), frame, on_pose
        self._uncarried_ns = 0
        super().__init__(node, Odometry, 'odom', self.hear, depth)

    def hear(self, message: Any) -> None:
        """Take in a message."""
        stamp_ns, pose = stamp_to_ns(message.header.stamp), odometry_from_message(message)
        if not stamp_ns or pose is None:
            line = 'odometry without a stamp, or that is no pose, is left out; mend its publisher'
            self._logger.warning(f'{self.topic}: {line}', once=True)
            return
        pose = self._frame.carried(pose, message.child_frame_id)
        if pose is None:
            self._uncarried_ns = self._uncarried_ns or stamp_ns
            if stamp_ns - self._uncarried_ns >= _TF_WAIT_NS:
                line = self._frame.problem(message.child_frame_id)
                self._logger.warning(f'{self.topic}: {line}', once=True)
            return
        self._on_pose(stamp_ns, pose, plain_frame(message.header.frame_id))
