# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages that the player sends, in the order of their times."""

from collections.abc import Iterator
import heapq
from itertools import chain
import struct
from typing import NamedTuple

from convseq_ros.errors import SourceError
from convseq_ros.node.conversions import image_message, stamp_from_ns
from convseq_ros.sources import Source
from convseq_ros.sources.raw_message import RawMessage, STAMP_END
from convseq_ros.sources.recording import Recording, TopicMessages
from sensor_msgs.msg import Image
from std_msgs.msg import Header

IMAGE = 'image'  # the cue of an image, and the topic of one that is in no recording
_OF_PICTURES = 'camera'  # the frame of images that are in no recording
_LEAD_NS = 1_000_000_000  # by which other topics start before the first image


class Cue(NamedTuple):
    """A message, its time in the recording in nanoseconds, and what it is: image, odom ..."""

    stamp_ns: int
    kind: str
    message: bytes | Image


def images_of(source: Source) -> Iterator[Cue]:
    if isinstance(source, Recording):
        for message in source.messages():
            yield Cue(message.stamp_ns, IMAGE, _stamped(message))
        return
    for frame in source:
        if frame.gray is not None:
            header = Header(stamp=stamp_from_ns(frame.stamp_ns), frame_id=_OF_PICTURES)
            yield Cue(frame.stamp_ns, IMAGE, image_message(frame.gray, header))
        elif frame.problem not in source.warnings:
            source.warnings.append(frame.problem)


def cues_of(source: Source, start_s: float, sides: dict[str, TopicMessages]) -> Iterator[Cue]:
    """Yield the images from `start_s` on, and other topics from 1 s before the first image."""
    images = images_of(source)
    begin_ns: int | None = None
    for first in images:
        begin_ns = begin_ns or first.stamp_ns + round(start_s * 1e9)
        if first.stamp_ns >= begin_ns:
            break
    else:
        raise SourceError(f'{source.name}: no images from --start {start_s:g} s on')
    later = (cue for cue in images if cue.stamp_ns >= begin_ns)
    beside = [_beside(name, sides[name], first.stamp_ns - _LEAD_NS) for name in sides]
    yield from heapq.merge(*beside, chain((first,), later), key=lambda cue: cue.stamp_ns)


def _beside(kind: str, messages: TopicMessages, begin_ns: int) -> Iterator[Cue]:
    """Yield the messages from a time on, and the last one before it, which may still be valid."""
    last: Cue | None = None
    for message in messages:
        if len(message.cdr) < STAMP_END:
            continue
        cue = Cue(message.stamp_ns, kind, _stamped(message))
        if cue.stamp_ns >= begin_ns:
            yield from (item for item in (last, cue) if item)
            last = None
        else:
            last = cue
    if last:
        yield last


def _stamped(message: RawMessage) -> bytes:
    """Return a message; a stamp of zero, which means none to ROS, is filled in."""
    if message.header_stamp_ns:
        return message.cdr
    cdr = bytearray(message.cdr)
    stamp = stamp_from_ns(message.stamp_ns)
    struct.pack_into('<iI' if cdr[1] & 1 else '>iI', cdr, 4, stamp.sec, stamp.nanosec)
    return bytes(cdr)
