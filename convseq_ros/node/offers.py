# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topics that other nodes offer, and those of them that fit a robot and its camera."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from convseq_ros.node.conversions import type_name
from convseq_ros.sources.topic_rank import best, camera_info_beside, image_rank, one_of_each_camera
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

IMAGE, COMPRESSED_IMAGE = type_name(Image), type_name(CompressedImage)
CAMERA_INFO, ODOMETRY = type_name(CameraInfo), type_name(Odometry)
_TYPES = frozenset({IMAGE, COMPRESSED_IMAGE, CAMERA_INFO, ODOMETRY})
_OURS = '/match_index'  # ends a topic that every vpr_node publishes below its name


@dataclass(frozen=True, slots=True)
class Offer:
    """A topic that nodes publish."""

    topic: str
    type_name: str  # such as sensor_msgs/msg/Image
    publishers: tuple[str, ...] = ()  # full names of nodes


def offers_of(node: Node) -> list[Offer]:
    """Return what is offered of images, their cameras and odometry, but not by a vpr_node."""
    topics, offers = node.get_topic_names_and_types(), list[Offer]()
    for topic, types in topics:
        publishers: dict[str, list[str]] = {}
        if _TYPES.intersection(types):
            for end in node.get_publishers_info_by_topic(topic):
                name = f'{end.node_namespace.rstrip("/")}/{end.node_name}'
                publishers.setdefault(end.topic_type, []).append(name)
        offers += [
            Offer(topic, kind, tuple(names))
            for kind, names in publishers.items()
            if kind in _TYPES
        ]
    return without_ours(offers, [topic for topic, _ in topics])


def without_ours(offers: Iterable[Offer], topics: Iterable[str]) -> list[Offer]:
    """Return the offers, given all topics, without what a vpr_node publishes."""
    ours = {topic.removesuffix(_OURS) for topic in topics if topic.endswith(_OURS)}
    below = tuple(f'{name}/' for name in ours)
    return [
        offer
        for offer in offers
        if not (ours.intersection(offer.publishers) or offer.topic.startswith(below))
    ]


@dataclass(frozen=True, slots=True)
class Search:
    """
    Finds the topics for a node in offers.

    Each method returns the best topics in the node's namespace: several if they are equally good,
    none if none fits.
    """

    offers: Sequence[Offer]
    namespace: str  # ends in a slash

    def images(self) -> list[str]:
        """Return the topic of the images: `image`, else that of the best camera."""
        raw = {*self._of(IMAGE)}
        # What is sent below a topic of raw images is another form of them.
        others = [it for it in self._of(COMPRESSED_IMAGE) if it.rpartition('/')[0] not in raw]
        topics = self._inside({*raw, *others})
        default = f'{self.namespace}image'
        ranked = best(topics, lambda it: (it != default, image_rank(it, self.namespace)))
        return one_of_each_camera(ranked)

    def camera_infos(self, image: str) -> list[str]:
        """Return the topic of a camera's CameraInfo: beside its images, or beside no others."""
        beside, offered = camera_info_beside(image), self._of(CAMERA_INFO)
        if beside in offered:
            return [beside]
        taken = {camera_info_beside(it) for it in (*self._of(IMAGE), *self._of(COMPRESSED_IMAGE))}
        default = f'{self.namespace}camera_info'
        return best(self._inside({*offered} - taken), lambda it: it != default)

    def odometries(self, image: str) -> list[str]:
        """Return the topic of odometry: `odom`, else one below the topmost folder of a camera."""
        default, folder = f'{self.namespace}odom', self._folder(image)
        topics = self._inside(self._of(ODOMETRY))
        return best(topics, lambda it: (it != default, self._folder(it) != folder))

    def _of(self, kind: str) -> list[str]:
        return [offer.topic for offer in self.offers if offer.type_name == kind]

    def _inside(self, topics: Iterable[str]) -> list[str]:
        return [topic for topic in topics if topic.startswith(self.namespace)]

    def _folder(self, topic: str) -> str:
        return topic.removeprefix(self.namespace).partition('/')[0]
