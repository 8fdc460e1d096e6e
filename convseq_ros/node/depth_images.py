# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The depth image of the moment of an image, from a topic."""

from collections import deque
import threading
from typing import Any

from convseq_ros.errors import ImageError
from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.node.subscription import FollowingSubscription
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources.depth import decode_depth, Depth, KEPT, nearest
from rclpy.node import Node
from sensor_msgs.msg import Image

_VAIN_WAITS = 3  # after which no image waits before depth comes again
_LOG_PERIOD_S = 10.0


class DepthImages:
    """
    Listens to a topic of depth images that are registered to the camera; to none if it is empty.

    An image waits for its depth for `wait_s`, in the worker's thread, and only while depth comes.
    `unreadable` counts depth images that could not be decoded, `missing` images without one since
    the first came.
    """

    def __init__(self, node: Node, topic: str, wait_s: float, reading: ReadingConfig) -> None:
        self.unreadable = self.missing = 0
        self._node, self._wait_s, self._reading = node, wait_s, reading
        self._waiting = deque[tuple[int, Any]](maxlen=KEPT)
        self._newest_ns: int | None = None
        self._waited_in_vain = 0
        self._changed = threading.Condition()
        self._subscription = (
            FollowingSubscription(node, Image, topic, self._on_depth, KEPT) if topic else None
        )

    def at(self, stamp_ns: int) -> Depth | None:
        """Return the depth image of a time; None if there is none."""
        if self._subscription is None:
            return None
        with self._changed:
            newest_ns = self._newest_ns
            if newest_ns is None:
                return None
            if newest_ns < stamp_ns and self._waited_in_vain < _VAIN_WAITS:
                if not self._changed.wait_for(lambda: self._has_reached(stamp_ns), self._wait_s):
                    self._waited_in_vain += 1
            found = nearest(self._waiting, stamp_ns)
        if found is None:
            self.missing += 1
            return None
        try:
            return decode_depth(found, self._reading)
        except ImageError as error:
            self.unreadable += 1
            line = f'{self._subscription.topic}: {error}; its frame has no depth'
            self._node.get_logger().warning(line, throttle_duration_sec=_LOG_PERIOD_S)
            return None

    def _has_reached(self, stamp_ns: int) -> bool:
        return self._newest_ns is not None and self._newest_ns >= stamp_ns

    def _on_depth(self, message: Any) -> None:
        with self._changed:
            self._newest_ns = stamp_to_ns(message.header.stamp)
            self._waiting.append((self._newest_ns, message))
            self._waited_in_vain = 0
            self._changed.notify()
