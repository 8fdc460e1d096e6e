# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The image topics of all cameras, raw or compressed."""

from collections import Counter
from collections.abc import Callable

from convseq_ros.errors import ConfigError
from convseq_ros.node.conversions import type_name
from convseq_ros.node.topic_finder import cameras, COMPRESSED
from convseq_ros.node.topics import FollowingSubscription
from convseq_ros.node_config import NodeConfig
from convseq_ros.sources.raw_message import RawMessage
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage, Image

QUEUE_BYTES = 256_000_000  # of images that wait, and as many again in the middleware
_FEWEST = 2  # images that the middleware may hold, however large: one comes while one is taken


class ImageSubscription(FollowingSubscription):
    """Hears a topic of images, which are compressed if its name ends in /compressed."""

    def __init__(
        self,
        node: Node,
        depth: int,
        on_image: Callable[[RawMessage, str], None],
        topic: str = 'image',
    ) -> None:
        self._on_image = on_image
        super().__init__(node, Image, topic, self._on_bytes, depth, starts=False, raw=True)

    @property
    def kind(self) -> type:
        return CompressedImage if self.topic.endswith(COMPRESSED) else Image

    def _on_bytes(self, cdr: bytes) -> None:
        self.hold_at_most(max(_FEWEST, QUEUE_BYTES // max(1, len(cdr))))
        self._on_image(RawMessage(0, type_name(self.kind), cdr), self.topic)

    def advice(self) -> str:
        """Say why no images may come and what to do about it, in one line."""
        publishers = self._node.get_publishers_info_by_topic(self.topic)
        types = [one.topic_type for one in publishers]
        if type_name(self.kind) in types:
            return f'{self.topic} has {len(types)} publisher(s), but none sends'
        if types:
            return (
                f'{self.topic} carries {", ".join(sorted(set(types)))}; remap `image` to a topic '
                f'of {type_name(Image)}, or of {type_name(CompressedImage)} that ends in '
                f'{COMPRESSED}'
            )
        found = cameras(self._node)
        names = ' or '.join(f'-r image:={topic}' for topic in found) or '-r image:=TOPIC'
        return f'{self.topic} has no publisher; remap it to the topic of the camera: {names}'


def image_subscriptions(
    node: Node, config: NodeConfig, on_image: Callable[[RawMessage, str], None]
) -> list[ImageSubscription]:
    """Return one for each of `image_topics`, or one for `image`; ConfigError if one is twice."""
    names = config.image_topics.split() or ['image']
    made = [ImageSubscription(node, config.queue_size, on_image, name) for name in names]
    for topic, count in Counter(one.topic for one in made).items():
        if count > 1:  # the map would get nothing
            raise ConfigError(f'image_topics: {topic} is there twice; name each once')
    return made
