# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the only camera on the graph, with its description and odometry, if nobody named one."""

from collections.abc import Callable
from shlex import quote

from convseq_ros.node.conversions import type_name
from convseq_ros.node.topics import steady_timer
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

_LOOK_S = 1.0
_LOOKS = 2  # alike, one after another, before it is believed: who is there is learnt by and by
COMPRESSED = '/compressed'  # ends the name of the topic beside raw images


class TopicFinder:
    """
    Looks for the topics of a camera as long as nothing is published on `image`, if not remapped.

    Its description is the CameraInfo beside it, or the only one; odometry is the only one, too.
    `follow` receives topics by what they are, 'image', 'camera_info' and 'odom'.
    """

    def __init__(
        self, node: Node, follow: Callable[[dict[str, str]], None], is_wanted: bool = True
    ) -> None:
        self._node = node
        self._follow = follow
        self._seen: list[str] = []
        self._looks = 0
        self._told: list[str] = []
        self._default = f'{node.get_namespace().rstrip("/")}/image'
        if is_wanted and node.resolve_topic_name('image') == self._default:
            self._timer = steady_timer(node, _LOOK_S, self._look)

    def _look(self) -> None:
        if self._node.count_publishers(self._default):
            self._looks = 0
            return
        found = cameras(self._node)
        self._looks = self._looks + 1 if found == self._seen else 1
        self._seen = found
        if not found or self._looks < _LOOKS:
            return
        if len(found) == 1:
            self._node.destroy_timer(self._timer)
            chosen = {'image': found[0], **_beside(self._node, found[0])}
            names = ', '.join(f'{what} is {topic}' for what, topic in chosen.items())
            self._node.get_logger().info(f'{names}: the only one; to choose, -r NAME:=TOPIC')
            self._follow(chosen)
        elif found != self._told:
            self._told = found
            self._node.get_logger().warning(
                f'{len(found)} camera topics; choose one:'
                + ''.join(f'\n  -r image:={quote(topic)}' for topic in found)
            )


def cameras(node: Node) -> list[str]:
    """Return topics of images that others publish; raw ones stand for their compressed ones."""
    raw = topics_of(node, Image)
    compressed = topics_of(node, CompressedImage)
    return sorted({*raw, *(one for one in compressed if one.removesuffix(COMPRESSED) not in raw)})


def topics_of(node: Node, *kinds: type) -> list[str]:
    """Return topics of some types that others publish."""
    names = {type_name(kind) for kind in kinds}
    own = node.get_fully_qualified_name() + '/'
    return sorted(
        topic
        for topic, types in node.get_topic_names_and_types()
        if names & {*types} and not topic.startswith(own) and node.count_publishers(topic)
    )


def camera_info_beside(image: str) -> str:
    """Return the topic that describes a camera, by convention, given that of its images."""
    return f'{image.removesuffix(COMPRESSED).rpartition("/")[0]}/camera_info'


def _beside(node: Node, image: str) -> dict[str, str]:
    """Return the camera's description and the odometry that there are, unless they are named."""
    found = {}
    infos, odometries = topics_of(node, CameraInfo), topics_of(node, Odometry)
    own = camera_info_beside(image)
    infos = [own] if own in infos else infos
    for what, topics in (('camera_info', infos), ('odom', odometries)):
        default = f'{node.get_namespace().rstrip("/")}/{what}'
        if node.resolve_topic_name(what) != default or default in topics:
            continue
        if len(topics) == 1:
            found[what] = topics[0]
        elif topics:
            node.get_logger().warning(
                f'{what}: {len(topics)} topics could be meant; to use one: '
                + ' or '.join(f'-r {what}:={quote(topic)}' for topic in topics)
            )
    return found
