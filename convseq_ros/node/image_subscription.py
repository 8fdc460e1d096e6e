# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The camera topic: raw or compressed, reliable if the camera offers it."""

from collections.abc import Callable
from typing import TypeAlias

from convseq_ros.node.conversions import type_name
from convseq_ros.node.subscription import FollowingSubscription
from convseq_ros.node.topic_finder import cameras, COMPRESSED
from convseq_ros.node_config import NodeConfig
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage, Image

ImageMessage: TypeAlias = Image | CompressedImage
_FEWEST = 2  # images that the middleware may hold, however large: one comes while one is taken
_TYPES = {'raw': Image, 'compressed': CompressedImage}


class ImageSubscription:
    """
    Subscribes to `image`, after remapping, or another topic, and keeps up the subscription.

    Best effort loses most raw images over 0.5 MB with default settings of the middleware, which is
    fatal for sequences: `auto` asks for reliable delivery, and gives way to best effort as soon as
    a camera turns out to offer nothing better. `on_image` receives each message, and its topic, in
    the executor's thread.
    """

    def __init__(
        self,
        node: Node,
        config: NodeConfig,
        on_image: Callable[[ImageMessage, str], None],
        topic: str = 'image',
    ) -> None:
        self._node = node
        self._config = config
        self._on_image = on_image
        self._transport = config.image_transport
        self._subscription: FollowingSubscription | None = None
        self._topic = node.resolve_topic_name(topic)
        if config.image_transport == 'compressed' and not self._topic.endswith(COMPRESSED):
            self._topic += COMPRESSED
        elif topic != 'image' and self._topic.endswith(COMPRESSED):
            self._transport = 'compressed'

    def start(self) -> None:
        """Begin to listen."""
        self._subscription = FollowingSubscription(
            self._node,
            _TYPES[self._transport],
            self._topic,
            self._on_message,
            self._config.queue_size,
            self._config.image_reliability,
        )

    def follow(self, topic: str) -> None:
        """Listen to another topic instead, and to compressed images if it is named so."""
        is_listening = self._subscription is not None
        self.stop()
        self._topic = topic
        self._transport = 'compressed' if topic.endswith(COMPRESSED) else 'raw'
        if is_listening:
            self.start()

    def stop(self) -> None:
        """Listen no more."""
        if self._subscription:
            self._subscription.destroy()
        self._subscription = None

    def _on_message(self, message: ImageMessage) -> None:
        fitting = round(self._config.queue_mb * 1e6) // max(1, len(message.data))
        if self._subscription and fitting < self._config.queue_size:
            self._subscription.hold_at_most(max(_FEWEST, fitting))
        self._on_image(message, self.topic)

    @property
    def topic(self) -> str:
        """The topic as it was resolved."""
        return self._subscription.topic if self._subscription else self._topic

    @property
    def lost(self) -> int:
        """Messages that did not arrive; see `FollowingSubscription`."""
        return self._subscription.lost if self._subscription else 0

    def advice(self) -> str:
        """Say why no images may come and what to do about it, in one line."""
        types = self._published(self.topic)
        wanted = _TYPES[self._transport]
        if not types:
            return self._advice_for_silence()
        if type_name(wanted) in types:
            return f'{self.topic} has {len(types)} publisher(s), but none sends'
        remedy = f'remap `image` to a topic of {type_name(wanted)}'
        if self._transport == 'raw' and type_name(CompressedImage) in types:
            if self.topic.endswith(COMPRESSED):
                remedy = 'set image_transport to compressed'
            else:
                remedy = (
                    f'publish it on {self.topic}{COMPRESSED} and set image_transport to compressed'
                )
        elif self._transport == 'compressed' and type_name(Image) in types:
            remedy = 'set image_transport to raw'
        return f'{self.topic} carries {", ".join(sorted(set(types)))}; {remedy}'

    def _advice_for_silence(self) -> str:
        text = f'{self.topic} has no publisher'
        if self._transport == 'raw':
            other, transport = self.topic + COMPRESSED, 'compressed'
        else:
            other, transport = self.topic.removesuffix(COMPRESSED), 'raw'
        if type_name(_TYPES[transport]) in self._published(other):
            return f'{text}, but {other} has: set image_transport to {transport}'
        found = cameras(self._node)
        names = ' or '.join(f'-r image:={topic}' for topic in found) or '-r image:=TOPIC'
        return f'{text}; remap it to the topic of the camera: {names}'

    def _published(self, topic: str) -> list[str]:
        return [info.topic_type for info in self._node.get_publishers_info_by_topic(topic)]
