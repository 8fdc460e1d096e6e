# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The depth image of an image."""

from collections import deque

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import ImageError, one_line
from convseq_ros.node.following_subscription import FollowingSubscription
from convseq_ros.node.listener import ListeningNode
from convseq_ros.node.missing import Missing
from convseq_ros.node.once import Once
from convseq_ros.node.waiting import Waiting
from convseq_ros.sources.depth import decode_depth, Depth, KEPT, nearest, unregistered
from convseq_ros.sources.raw_message import IMAGE, RawMessage
from sensor_msgs.msg import Image


class DepthImages:
    """Listens to depth images, if a topic is given; counts unreadable and missing ones."""

    def __init__(
        self, node: ListeningNode, topic: str, wait_s: float, reading: ReadingConfig
    ) -> None:
        self.unreadable, self.missing = 0, Missing(node.get_logger(), 'depth image')
        self._once, self._reading = Once(node.get_logger()), reading
        self._newest = deque[tuple[int, RawMessage]](maxlen=KEPT)
        self.waiting = Waiting(wait_s)
        self.topic, self._subscription = topic, None
        if topic:
            self._subscription = FollowingSubscription(
                node, Image, topic, self._on_depth, KEPT, raw=True
            )

    @property
    def silence(self) -> str:
        """Why no depth images come; empty if they do, or need not."""
        if not (self._subscription and (silent_s := self._subscription.silent_s)):
            return ''
        wrong = self._subscription.mismatch
        why = f'{self.topic} carries {wrong}' if wrong else f'nothing on {self.topic}'
        return f'no depth images for {silent_s:.0f} s: {why}; look at their driver, or depth_topic'

    def configure(self, wait_s: float, reading: ReadingConfig) -> None:
        """Use another time to wait, and other limits of what is read, from now on."""
        self.waiting.configure(wait_s)
        self._reading = reading

    def at(self, stamp_ns: int) -> Depth | None:
        """Return the depth image of a time; None if there is none."""
        with self.waiting.changed:
            if not self._newest:
                return None
            self.waiting.wait_until(lambda: self._newest[-1][0] >= stamp_ns)
            message, last_ns = nearest(self._newest, stamp_ns), self._newest[-1][0]
        self.missing.note(message is None, self.topic, stamp_ns, last_ns)
        if message is None:
            return None
        try:
            return decode_depth(message.image(), self._reading)
        except ImageError as error:
            self.unreadable += 1
            self._once.warn(f'{self.topic}: {one_line(error)}; its frame has no depth')
            return None

    def check(self, depth_m: Depth, shape: tuple[int, ...]) -> None:
        """Count and report a depth image that cannot be registered to its image, (H, W)."""
        if line := unregistered(depth_m, shape):
            self.unreadable += 1
            self._once.warn(f'{self.topic}: {line}')

    def _on_depth(self, cdr: bytes) -> None:
        message = RawMessage(0, IMAGE, cdr)
        with self.waiting.changed:
            self._newest.append((message.header_stamp_ns, message))
            self.waiting.notify()
