# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sends false closures while a drive is played, for `convseq demo --slam`."""

import sys
from typing import Any

from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.node.running import run_until_signal
from nav_msgs.msg import Odometry
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

_DEPTH = 1000


class FalseClosures(Node):
    """Publishes each pair of stamps, query and reference, when odometry has reached the query."""

    def __init__(self, pairs: list[tuple[int, int]]) -> None:
        super().__init__('false_closures')
        self._pairs = sorted(pairs)
        topic = '/vpr_node/loop_closure'
        self._publisher = self.create_publisher(Float64MultiArray, topic, _DEPTH)
        self.create_subscription(Odometry, 'odom', self._on_odometry, _DEPTH)
        self.get_logger().info('listening to odom')

    def _on_odometry(self, message: Any) -> None:
        while self._pairs and self._pairs[0][0] < stamp_to_ns(message.header.stamp):
            seconds = [stamp_ns / 1e9 for stamp_ns in self._pairs.pop(0)]
            self._publisher.publish(Float64MultiArray(data=seconds))


def main() -> int:
    """Run with stamps as arguments: query, reference, query, and so on."""
    stamps = [int(word) for word in sys.argv[1:]]
    pairs = list(zip(stamps[::2], stamps[1::2], strict=True))
    return run_until_signal(lambda: FalseClosures(pairs), [], 'false_closures')


if __name__ == '__main__':
    sys.exit(main())
