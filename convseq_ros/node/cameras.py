# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The image topics of all cameras, raw or compressed; the only camera if no topic is given."""

from collections import Counter
from collections.abc import Callable
from shlex import quote

from convseq_ros.config.node_config import NodeConfig
from convseq_ros.errors import ConfigError
from convseq_ros.node.conversions import type_name
from convseq_ros.node.listener import ListeningNode
from convseq_ros.node.topics import FollowingSubscription, steady_timer
from convseq_ros.sources.raw_message import RawMessage
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

COMPRESSED = '/compressed'  # ends the name of the topic beside raw images
QUEUE_BYTES = 256_000_000  # of waiting images; the middleware may hold as much again
_FEWEST = 2  # images that the middleware may always hold: the next one arrives while one is taken
_LOOK_S = 1.0
_LOOKS = 2  # with the same result, in a row, before it is used: discovery takes time


class ImageSubscription(FollowingSubscription):
    """Subscribes to a topic of images, compressed if its name ends in /compressed."""

    def __init__(
        self,
        node: ListeningNode,
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
        """Return in one line why no images may arrive, and what to do about it."""
        publishers = self._node.get_publishers_info_by_topic(self.topic)
        types = [publisher.topic_type for publisher in publishers]
        if type_name(self.kind) in types:
            return f'{self.topic} has {len(types)} publisher(s), but none sends'
        if types:
            return (
                f'{self.topic} carries {", ".join(sorted(set(types)))}; remap `image` to a topic '
                f'of {type_name(Image)}, or of {type_name(CompressedImage)} that ends in '
                f'{COMPRESSED}'
            )
        topics = cameras(self._node)
        names = ' or '.join(f'-r image:={topic}' for topic in topics) or '-r image:=TOPIC'
        return f'{self.topic} has no publisher; remap it to the topic of the camera: {names}'


def image_subscriptions(
    node: ListeningNode, config: NodeConfig, on_image: Callable[[RawMessage, str], None]
) -> list[ImageSubscription]:
    """Return one for each of `image_topics`, or one for `image`; ConfigError for repeated ones."""
    names = config.image_topics.split() or ['image']
    made = [ImageSubscription(node, config.queue_size, on_image, name) for name in names]
    for topic, count in Counter(subscription.topic for subscription in made).items():
        if count > 1:  # the map would get no places
            raise ConfigError(f'image_topics: {topic} is there twice; name each once')
    return made


class TopicFinder:
    """
    Looks for a camera's topics while nothing is published on `image`, unless that is remapped.

    CameraInfo is the topic beside the images, or the only one; odometry is the only topic of it.
    `follow` receives the topics by name: 'image', 'camera_info' and 'odom'.
    """

    def __init__(
        self, node: Node, follow: Callable[[dict[str, str]], None], is_wanted: bool = True
    ) -> None:
        self._node = node
        self._follow = follow
        self._seen: list[str] = []
        self._looks = 0
        self._reported: list[str] = []
        self._default = f'{node.get_namespace().rstrip("/")}/image'
        if is_wanted and node.resolve_topic_name('image') == self._default:
            self._timer = steady_timer(node, _LOOK_S, self._look)

    def _look(self) -> None:
        if self._node.count_publishers(self._default):
            self._looks = 0
            return
        topics = cameras(self._node)
        self._looks = self._looks + 1 if topics == self._seen else 1
        self._seen = topics
        if not topics or self._looks < _LOOKS:
            return
        if len(topics) == 1:
            self._node.destroy_timer(self._timer)
            chosen = {'image': topics[0], **_beside(self._node, topics[0])}
            names = ', '.join(f'{name} is {topic}' for name, topic in chosen.items())
            self._node.get_logger().info(f'{names}: the only one; to choose, -r NAME:=TOPIC')
            self._follow(chosen)
        elif topics != self._reported:
            self._reported = topics
            self._node.get_logger().warning(
                f'{len(topics)} camera topics; choose one:'
                + ''.join(f'\n  -r image:={quote(topic)}' for topic in topics)
            )


def cameras(node: Node) -> list[str]:
    """Return the image topics of other nodes; a compressed one only if there is no raw one."""
    raw = topics_of(node, Image)
    others = topics_of(node, CompressedImage)
    return sorted({*raw, *(name for name in others if name.removesuffix(COMPRESSED) not in raw)})


def topics_of(node: Node, *kinds: type) -> list[str]:
    """Return the topics of some types that other nodes publish."""
    names = {type_name(kind) for kind in kinds}
    prefix = node.get_fully_qualified_name() + '/'
    return sorted(
        topic
        for topic, types in node.get_topic_names_and_types()
        if names & {*types} and not topic.startswith(prefix) and node.count_publishers(topic)
    )


def camera_info_beside(image: str) -> str:
    """Return the conventional topic of a camera's CameraInfo, given that of its images."""
    return f'{image.removesuffix(COMPRESSED).rpartition("/")[0]}/camera_info'


def _beside(node: Node, image: str) -> dict[str, str]:
    """Return the topics of CameraInfo and odometry to use, unless they are remapped."""
    chosen = {}
    infos, odometries = topics_of(node, CameraInfo), topics_of(node, Odometry)
    usual = camera_info_beside(image)
    infos = [usual] if usual in infos else infos
    for name, topics in (('camera_info', infos), ('odom', odometries)):
        default = f'{node.get_namespace().rstrip("/")}/{name}'
        if node.resolve_topic_name(name) != default or default in topics:
            continue
        if len(topics) == 1:
            chosen[name] = topics[0]
        elif topics:
            node.get_logger().warning(
                f'{name}: {len(topics)} topics could be meant; to use one: '
                + ' or '.join(f'-r {name}:={quote(topic)}' for topic in topics)
            )
    return chosen
