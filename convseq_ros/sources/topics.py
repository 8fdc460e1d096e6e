# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Choosing the topic to read from a recording."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from convseq_ros.errors import SourceError

IMAGE_TYPES = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage')
CAMERA_TYPES = ('sensor_msgs/msg/CameraInfo',)
ODOMETRY_TYPES = ('nav_msgs/msg/Odometry',)
POSE_TYPES = (
    *ODOMETRY_TYPES,
    'geometry_msgs/msg/PoseStamped',
    'geometry_msgs/msg/PoseWithCovarianceStamped',
)
FIX_TYPES = ('sensor_msgs/msg/NavSatFix',)


@dataclass(frozen=True, slots=True)
class Topic:
    """What a recording tells of one of its topics."""

    name: str
    type_name: str
    count: int

    def __str__(self) -> str:
        messages = 'message' if self.count == 1 else 'messages'
        return f'{self.name}   # {self.type_name}, {self.count} {messages}'


class Index(NamedTuple):
    """What there is to know of a recording's file before its messages are read."""

    topics: dict[str, Topic]
    duration_s: float  # from the first message of any topic to the last
    damage: str = ''  # what is wrong with the file, though it can be read to some extent


def merge_topics(tables: Iterable[Mapping[str, Topic]]) -> dict[str, Topic]:
    """Return one table of the topics of several files; messages of a topic are added up."""
    merged: dict[str, Topic] = {}
    for table in tables:
        for name, topic in table.items():
            count = topic.count + (merged[name].count if name in merged else 0)
            first = merged.get(name, topic)
            merged[name] = Topic(name, first.type_name, count)
    return merged


def choose_topic(
    path: Path, topics: Mapping[str, Topic], wanted: str, types: tuple[str, ...], option: str
) -> Topic:
    """
    Return the wanted topic, or, if the name is empty, the only one of some types with messages.

    SourceError if the choice is not clear: it names the recording and lists the right topics, one
    a line, ready to paste behind the `option` by which a user asks for one, such as '--topic'.
    """
    fitting = [topic for topic in topics.values() if topic.type_name in types and topic.count > 0]
    if not fitting:
        kind = ' or '.join(name.split('/')[-1] for name in types)
        found = ', '.join(f'{topic.name} ({topic.type_name})' for topic in topics.values())
        raise SourceError(
            f'{path}: no {kind} messages in this recording; it holds {found or "nothing"}'
        )
    listing = ''.join(f'\n{option} {topic}' for topic in fitting)
    if not wanted:
        if len(fitting) > 1:
            raise SourceError(f'{path}: {len(fitting)} topics could be meant; add one of{listing}')
        return fitting[0]
    for topic in fitting:
        if topic.name == wanted or topic.name == f'/{wanted}':
            return topic
    if wanted not in topics:
        problem = f'no topic {wanted!r}'
    elif topics[wanted].type_name in types:
        problem = f'topic {wanted!r} has no messages'
    else:
        problem = f'topic {wanted!r} is of type {topics[wanted].type_name}'
    raise SourceError(f'{path}: {problem}; use{listing}')
