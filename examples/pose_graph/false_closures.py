# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that lies: publishes false closures on `loop_closure` when odometry has come so far."""

import json
from pathlib import Path
import signal
import sys
from typing import Any

from nav_msgs.msg import Odometry
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import try_shutdown
from std_msgs.msg import Float64MultiArray


class FalseClosures(Node):
    """Publishes each pair of seconds, the later one first, as soon as odometry is later."""

    def __init__(self, pairs: list[list[float]]) -> None:
        super().__init__('false_closures')
        self._pairs = sorted(pairs)
        self._closures = self.create_publisher(Float64MultiArray, 'loop_closure', 10)
        self.create_subscription(Odometry, 'odom', self._on_odometry, 1000)

    def _on_odometry(self, message: Any) -> None:
        now_s = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
        while self._pairs and self._pairs[0][0] < now_s:
            self._closures.publish(Float64MultiArray(data=self._pairs.pop(0)))


def main() -> int:
    """Publish the pairs of a JSON file until SIGINT."""
    signal.signal(signal.SIGINT, lambda *_: None)
    pairs = json.loads(Path(sys.argv[1]).read_text())
    rclpy.init()
    node = FalseClosures(pairs)
    try:
        # A signal just before the executor waits does not wake it: it looks up now and then.
        while rclpy.ok():
            rclpy.spin_once(node, timeout_sec=0.2)
    except ExternalShutdownException:
        pass
    finally:
        node.destroy_node()
        try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
