# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a player sends: the images of a recording, and messages of other topics between them."""

from collections.abc import Iterator
from dataclasses import dataclass
import heapq
from pathlib import Path
import struct
from typing import NamedTuple

from convseq_ros.errors import SourceError
from convseq_ros.node.conversions import image_message, stamp_from_ns
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import Source
from convseq_ros.sources.recording import messages_of, Recording
from convseq_ros.sources.topics import CAMERA_TYPES, ODOMETRY_TYPES, RawMessage, STAMP_END
from sensor_msgs.msg import Image
from std_msgs.msg import Header

IMAGE, ODOM, CAMERA_INFO = 'image', 'odom', 'camera_info'
_SOUGHT = {ODOM: (ODOMETRY_TYPES, '--odom'), CAMERA_INFO: (CAMERA_TYPES, '--camera-info')}
_LEAD_NS = 1_000_000_000


class Cue(NamedTuple):
    """A message, when it is due (nanoseconds, time of the recording), and what it is."""

    stamp_ns: int
    what: str
    message: bytes | Image


@dataclass(eq=False)
class Playlist:
    """The images of a source from `start_s` on, with messages of other topics between them."""

    source: Source
    path: Path
    sides: dict[str, str]  # topics of the recording for `ODOM` and `CAMERA_INFO`, if played
    start_s: float
    reading: ReadingConfig = ReadingConfig()

    def __post_init__(self) -> None:
        for what in self.sides:
            self._messages(what)

    @property
    def first_size(self) -> int:
        """Bytes of the first image, which tell how large the others are; 0 for none."""
        for cue in self._images():
            return len(cue.message) if isinstance(cue.message, bytes) else len(cue.message.data)
        return 0

    def __iter__(self) -> Iterator[Cue]:
        """Yield the cues; the first image follows what the others said in the second before."""
        images = self._images()
        begin_ns: int | None = None
        for first in images:
            begin_ns = begin_ns or first.stamp_ns + round(self.start_s * 1e9)
            if first.stamp_ns >= begin_ns:
                break
        else:
            raise SourceError(f'{self.source.name}: no images from --start {self.start_s:g} s on')
        rest = (cue for cue in images if cue.stamp_ns >= begin_ns)
        sides = [_from(self._side(what), first.stamp_ns - _LEAD_NS) for what in self.sides]
        yield from heapq.merge(*sides, _after(first, rest), key=lambda cue: cue.stamp_ns)

    def _images(self) -> Iterator[Cue]:
        if isinstance(self.source, Recording):
            for message in self.source.messages():
                yield Cue(message.stamp_ns, IMAGE, _stamped(message))
            return
        for frame in self.source:
            if frame.gray is not None:
                stamp = stamp_from_ns(frame.stamp_ns)
                image = image_message(frame.gray, Header(stamp=stamp))
                yield Cue(frame.stamp_ns, IMAGE, image)

    def _side(self, what: str) -> Iterator[Cue]:
        for message in self._messages(what):
            if len(message.cdr) >= STAMP_END:
                yield Cue(message.stamp_ns, what, _stamped(message))

    def _messages(self, what: str) -> Iterator[RawMessage]:
        return messages_of(self.path, self.sides[what], *_SOUGHT[what], self.reading)[1]


def _after(first: Cue, rest: Iterator[Cue]) -> Iterator[Cue]:
    yield first
    yield from rest


def _from(cues: Iterator[Cue], begin_ns: int) -> Iterator[Cue]:
    """Leave out what lies before a time, but for the last of it, which may still hold."""
    last: Cue | None = None
    for cue in cues:
        if cue.stamp_ns < begin_ns:
            last = cue
            continue
        if last:
            yield last
            last = None
        yield cue
    if last:
        yield last


def _stamped(message: RawMessage) -> bytes:
    """Return a message; a stamp of zero, which ROS takes for none, is filled in."""
    if message.header_stamp_ns:
        return message.cdr
    cdr = bytearray(message.cdr)
    stamp = stamp_from_ns(message.stamp_ns)
    struct.pack_into('<iI' if cdr[1] & 1 else '>iI', cdr, 4, stamp.sec, stamp.nanosec)
    return bytes(cdr)
