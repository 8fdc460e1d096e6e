# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a recording, and its messages as they lie in it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import functools
from pathlib import Path
import struct
from typing import Any, NamedTuple

from convseq_ros.errors import ConvseqError, ImageError, one_line, pip_install, SourceError

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
    """Return the wanted topic, or the only one of some types; SourceError lists them, to paste."""
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


MAX_STAMP_NS = 2**63 - 1
STAMP_END = 12  # bytes: CDR header, seconds, nanoseconds


class RawMessage(NamedTuple):
    """One serialized message."""

    log_time_ns: int  # when it was recorded
    type_name: str  # such as sensor_msgs/msg/Image
    cdr: bytes  # as rclpy publishes it; empty if it was too damaged to convert

    @property
    def header_stamp_ns(self) -> int:
        """Stamp of a message that starts with a std_msgs/Header; 0 if unset or unreadable."""
        if len(self.cdr) < STAMP_END:
            return 0
        seconds, nanoseconds = struct.unpack_from('<iI' if self.cdr[1] & 1 else '>iI', self.cdr, 4)
        return int(seconds) * 1_000_000_000 + int(nanoseconds)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the header; if that is unset, the time of recording."""
        return self.header_stamp_ns or min(self.log_time_ns, MAX_STAMP_NS)

    def decode(self) -> Any:
        """Return the message with its fields; ImageError if it is damaged."""
        try:
            return typestore().deserialize_cdr(self.cdr, self.type_name)
        except Exception as error:
            raise ImageError(
                f'a {self.type_name} of {len(self.cdr)} bytes is damaged ({one_line(error)})'
            ) from None


@functools.cache
def typestore() -> Any:
    """Return the message definitions of ROS 2 Jazzy; ConvseqError if rosbags is not installed."""
    try:
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise ConvseqError(
            'rosbags is not installed, but recordings need it; '
            + pip_install('rosbags', 'mcap', 'zstandard')
        ) from None
    return get_typestore(Stores.ROS2_JAZZY)
