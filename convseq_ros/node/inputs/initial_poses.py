# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where others say that the robot is, as RViz and nav2 do."""

from collections import deque
from collections.abc import Callable
from typing import Any

from convseq_ros.core.rigid import pose_of
from convseq_ros.core.types import PoseEstimate
from convseq_ros.node.inputs.closures_heard import uncertain_pose
from convseq_ros.node.inputs.following_subscription import FollowingSubscription
from convseq_ros.node.inputs.listener import ListeningNode
from convseq_ros.sources.mount import plain_frame
from geometry_msgs.msg import PoseWithCovarianceStamped

_DEPTH = 10


class InitialPoses:
    """
    Hears `initialpose`, and calls `expect` with each pose in the frame of the map.

    What this node has `sent` itself is passed over; what is left out is counted.
    """

    def __init__(
        self, node: ListeningNode, map_frame: str, expect: Callable[[PoseEstimate], None]
    ) -> None:
        self.sent, self.left_out = deque[Any](maxlen=_DEPTH), 0
        self._logger, self._map_frame, self._expect = node.get_logger(), map_frame, expect
        self._subscription = FollowingSubscription(
            node, PoseWithCovarianceStamped, 'initialpose', self._on_pose, _DEPTH
        )

    def leave_out(self, why: str) -> None:
        """Count a pose that is of no use; say why, once."""
        self.left_out += 1
        line = f'{self._subscription.topic}: {why}; such poses are left out, and counted'
        self._logger.warning(line, once=True)

    def _on_pose(self, message: Any) -> None:
        if message in self.sent:
            return
        found, frame = uncertain_pose(message), message.header.frame_id
        if found is None:
            self.leave_out('a pose or a covariance is not finite, or none')
        elif plain_frame(frame) != plain_frame(self._map_frame):
            self.leave_out(
                f'a pose is in frame {frame!r}, not in {self._map_frame!r}; set the fixed frame '
                'of its sender, or map_frame'
            )
        else:
            self._expect(PoseEstimate(pose_of(found[0]), found[1]))
