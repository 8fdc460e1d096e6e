# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The image topics of all cameras, raw or compressed."""

from collections import Counter
from collections.abc import Callable

from convseq_ros.config.node_config import NodeConfig
from convseq_ros.errors import ConfigError
from convseq_ros.node.conversions import type_name
from convseq_ros.node.inputs.following_subscription import FollowingSubscription
from convseq_ros.node.inputs.listener import ListeningNode
from convseq_ros.node.qos import steady_timer
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topic_rank import camera_info_beside, COMPRESSED, image_rank
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage, Image

QUEUE_BYTES = 256_000_000  # of waiting images; the middleware may hold as much again
_FEWEST = 2  # images that the middleware may always hold: the next one arrives while one is taken
_PERIOD_S = 1.0
_REMAPPED = 'image'  # topic of a single camera
_DRAWN = '/debug_image'  # ends the topic of pictures that this package's nodes draw


class ImageSubscription(FollowingSubscription):
    """
    Subscribes to a topic of images, raw or compressed as its publisher sends them.

    Until there is one, they are taken for compressed if the topic's name ends in /compressed.
    """

    def __init__(
        self,
        node: ListeningNode,
        depth: int,
        on_image: Callable[[RawMessage, str], None],
        topic: str = _REMAPPED,
    ) -> None:
        self._on_image, self._is_stopped_to_change = on_image, False
        self._is_named = topic != _REMAPPED  # by image_topics
        super().__init__(node, Image, topic, self._on_bytes, depth, starts=False, raw=True)
        self._timer = steady_timer(node, _PERIOD_S, self._follow_type)

    def start(self) -> None:
        by_name = CompressedImage if self.topic.endswith(COMPRESSED) else Image
        self.kind = self._published() or by_name
        super().start()

    def stop(self) -> None:
        self._is_stopped_to_change = False
        super().stop()

    def _follow_type(self) -> None:
        with self._changing:
            if self._is_stopped_to_change:
                try:
                    self.start()
                except RuntimeError:  # the listener has not let go of the old one yet
                    self._is_stopped_to_change = True
            elif self._subscription and (self._published() or self.kind) is not self.kind:
                # In a process a topic has one type, as long as anybody holds it.
                self.stop()
                self._is_stopped_to_change = True

    def _published(self) -> type | None:
        """Return the type of the topic; None if no images are published, or both types are."""
        published = self._node.get_publishers_info_by_topic(self.topic)
        types = {publisher.topic_type for publisher in published}
        kinds = [kind for kind in (Image, CompressedImage) if type_name(kind) in types]
        return kinds[0] if len(kinds) == 1 else None

    def _on_bytes(self, cdr: bytes) -> None:
        self.hold_at_most(max(_FEWEST, QUEUE_BYTES // max(1, len(cdr))))
        self._on_image(RawMessage(0, type_name(self.kind), cdr), self.topic)

    @property
    def silence(self) -> str:
        """Why no images come; empty if they do."""
        if not (silent_s := self.silent_s):
            return ''
        if self.heard:
            stopped = f'the camera stopped: no images on {self.topic} for {silent_s:.0f} s'
            return f'{stopped}; look at its driver'
        return f'no images for {silent_s:.0f} s: {self.advice()}'

    def advice(self) -> str:
        """Return in one line why no images may arrive, and what to do."""
        publishers = self._node.get_publishers_info_by_topic(self.topic)
        types = [publisher.topic_type for publisher in publishers]
        if type_name(self.kind) in types:
            return f'{self.topic} has {len(types)} publisher(s), but none sends'
        if types:
            remedy = 'let image_topics name' if self._is_named else 'remap `image` to'
            return (
                f'{self.topic} carries {", ".join(sorted(set(types)))}; {remedy} a topic of '
                f'{type_name(Image)} or {type_name(CompressedImage)}'
            )
        if self._is_named:
            return f'{self.topic} has no publisher; look at its driver, or at image_topics'
        if not (others := topics_with_images(self._node)):
            return f'{self.topic} has no publisher, nor has any other topic of images; start one'
        best, infos = others[0], camera_info_beside(others[0])
        also = f' -r camera_info:={infos}' if self._node.count_publishers(infos) else ''
        return (
            f'{self.topic} has no publisher; images are on {", ".join(others)}; to take the '
            f'first: -r image:={best}{also}'
        )


def topics_with_images(node: Node) -> list[str]:
    """Return the topics that carry images: those of the namespace first, then by their rank."""
    namespace, kinds = node.get_namespace(), {type_name(Image), type_name(CompressedImage)}
    topics = [
        topic
        for topic, types in node.get_topic_names_and_types()
        if kinds.intersection(types) and node.count_publishers(topic) and _DRAWN not in topic
    ]
    return sorted(topics, key=lambda it: (not it.startswith(namespace), image_rank(it), it))


def image_subscriptions(
    node: ListeningNode, config: NodeConfig, on_image: Callable[[RawMessage, str], None]
) -> list[ImageSubscription]:
    """Return one for each of `image_topics`, or one for `image`; ConfigError for repeated ones."""
    names = config.image_topics.split() or [_REMAPPED]
    made = [ImageSubscription(node, config.queue_size, on_image, name) for name in names]
    for topic, count in Counter(subscription.topic for subscription in made).items():
        if count > 1:  # the map would get no places
            raise ConfigError(f'image_topics: {topic} is there twice; name each once')
    return made
