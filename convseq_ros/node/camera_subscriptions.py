# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The image topics of all cameras."""

from collections import Counter
from collections.abc import Callable

from convseq_ros.errors import ConfigError
from convseq_ros.node.image_subscription import ImageMessage, ImageSubscription
from convseq_ros.node_config import NodeConfig
from rclpy.node import Node


class CameraSubscriptions:
    """
    Subscribes to each of `image_topics`, or else to `image`, as `ImageSubscription` does.

    `on_image` receives each message, and its topic, in the executor's thread. ConfigError if a
    topic is there twice.
    """

    def __init__(
        self, node: Node, config: NodeConfig, on_image: Callable[[ImageMessage, str], None]
    ) -> None:
        names = config.image_topics.split() or ['image']
        self._all = [ImageSubscription(node, config, on_image, name) for name in names]
        for topic, count in Counter(self.topics).items():
            if count > 1:  # the map would get nothing
                raise ConfigError(f'image_topics: {topic} is there twice; name each once')

    @property
    def topics(self) -> list[str]:
        """The topics as they were resolved."""
        return [one.topic for one in self._all]

    @property
    def topic(self) -> str:
        """The same, with spaces between."""
        return ' '.join(self.topics)

    @property
    def lost(self) -> int:
        """Messages that did not arrive."""
        return sum(one.lost for one in self._all)

    def start(self) -> None:
        """Begin to listen."""
        for one in self._all:
            one.start()

    def stop(self) -> None:
        """Listen no more."""
        for one in self._all:
            one.stop()

    def follow(self, topic: str) -> None:
        """Listen to another topic instead of the only one."""
        self._all[0].follow(topic)

    def advice(self) -> str:
        """Say why no images may come and what to do about it, in one line."""
        return '; '.join(one.advice() for one in self._all)
