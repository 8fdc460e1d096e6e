# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a recording, and the fields of its messages."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import functools
from pathlib import Path
from shlex import quote
from typing import Any, NamedTuple

from convseq_ros.errors import load, SourceError
from convseq_ros.sources.raw_message import damaged, RawMessage, REPUBLISH

TF_TYPES = ('tf2_msgs/msg/TFMessage',)
CAMERA_TYPES = ('sensor_msgs/msg/CameraInfo',)
ODOMETRY_TYPES = ('nav_msgs/msg/Odometry',)
POSE_TYPES = (
    *ODOMETRY_TYPES,
    'geometry_msgs/msg/PoseStamped',
    'geometry_msgs/msg/PoseWithCovarianceStamped',
)
# By option, types that have images or poses in a form that is not read, and what helps.
NOT_READ = {
    '--topic': dict.fromkeys((
        'ffmpeg_image_transport_msgs/msg/FFMPEGPacket', 'foxglove_msgs/msg/CompressedVideo',
        'theora_image_transport/msg/Packet',
    ), REPUBLISH),
    '--odom': dict.fromkeys(TF_TYPES, 'has transforms, not poses: `evo_traj bag2 RECORDING '
        '/tf:odom.base_link --save_as_tum` makes a file for --poses'),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a recording."""

    name: str
    type_name: str
    count: int


class Index(NamedTuple):
    """The content of a recording's file, available before its messages are read."""

    topics: dict[str, Topic]
    start_ns: int  # when the first message of any topic was recorded
    end_ns: int  # when the last one was
    damage: str = ''  # of a file that can be read in part; else empty


class ForeignRecording(SourceError):
    """A whole recording, but not of ROS."""


def merge_topics(tables: Iterable[Mapping[str, Topic]]) -> dict[str, Topic]:
    """Return one table of the topics of several files; the counts of a topic are added."""
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
    """Return the wanted topic, or the only one of some types; else a SourceError names them."""
    fitting = [topic for topic in topics.values() if topic.type_name in types and topic.count > 0]
    if not fitting:
        kind = ' or '.join(name.split('/')[-1] for name in types)
        others = ', '.join(f'{topic.name} ({topic.type_name})' for topic in topics.values())
        raise SourceError(
            f'{path}: no {kind} messages in this recording; it holds {others or "nothing"}'
            + ''.join(f'; {line}' for line in not_read(topics.values(), option))
        )
    choices = ' or '.join(f'{option} {quote(topic.name)}' for topic in fitting)
    if not wanted:
        if len(fitting) > 1:
            raise SourceError(f'{path}: {len(fitting)} topics could be meant; add {choices}')
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
    raise SourceError(f'{path}: {problem}; use {choices}')


def not_read(topics: Iterable[Topic], option: str) -> list[str]:
    """Return a line for each topic that an option could name if its type were another."""
    remedies = NOT_READ.get(option, {})
    return [
        f'{topic.name} {remedies[topic.type_name]}'
        for topic in topics
        if topic.type_name in remedies and not topic.name.endswith('_static')
    ]


def decode(message: RawMessage) -> Any:
    """Return a message with its fields; ImageError if it is damaged."""
    try:
        return typestore().deserialize_cdr(message.cdr, message.type_name)
    except Exception as error:
        raise damaged(message, error) from None


@functools.cache
def typestore() -> Any:
    """Return the message definitions of ROS 2 Jazzy; ConvseqError if rosbags is not installed."""
    types = load('rosbags.typesys', 'a recording')
    return types.get_typestore(types.Stores.ROS2_JAZZY)
