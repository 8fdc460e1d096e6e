# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a player publishes, in order of time."""

from collections.abc import Iterator
import heapq
from pathlib import Path
import struct
import time
from typing import NamedTuple

from convseq_ros.errors import SourceError
from convseq_ros.node.conversions import image_message, stamp_from_ns
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import Source
from convseq_ros.sources.raw_message import RawMessage, STAMP_END
from convseq_ros.sources.recording import messages_of, Recording
from convseq_ros.sources.topics import CAMERA_TYPES, ODOMETRY_TYPES
from sensor_msgs.msg import Image
from std_msgs.msg import Header

IMAGE, ODOM, CAMERA_INFO = 'image', 'odom', 'camera_info'
_SIDES = {ODOM: (ODOMETRY_TYPES, '--odom'), CAMERA_INFO: (CAMERA_TYPES, '--camera-info')}
_LEAD_NS = 1_000_000_000


class Cue(NamedTuple):
    """A message, when it is due (nanoseconds, time of the recording), and what it is."""

    stamp_ns: int
    what: str
    message: bytes | Image


class Playlist:
    """
    The images of a source, from `start_s` on, with the messages of other topics between them.

    `sides` names the topics of the recording at `path` for `ODOM` and `CAMERA_INFO`, if they are
    played as well. SourceError if one of them is not there.
    """

    def __init__(
        self,
        source: Source,
        path: Path,
        sides: dict[str, str],
        start_s: float,
        reading: ReadingConfig = ReadingConfig(),
    ) -> None:
        self._source, self._reading = source, reading
        self._path = path
        self._sides = sides
        self._start_s = start_s
        for what in sides:
            self._messages(what)

    @property
    def first_size(self) -> int:
        """Bytes of the first image, which tell how large the others are; 0 for none."""
        for cue in self._images():
            return len(cue.message) if isinstance(cue.message, bytes) else len(cue.message.data)
        return 0

    def __iter__(self) -> Iterator[Cue]:
        """
        Yield the cues; the first image follows what the others said in the second before.

        SourceError if there is no image, or it is damaged further on.
        """
        images = self._images()
        begin_ns: int | None = None
        for first in images:
            begin_ns = begin_ns or first.stamp_ns + round(self._start_s * 1e9)
            if first.stamp_ns >= begin_ns:
                break
        else:
            raise SourceError(
                f'{self._source.name}: no images from --start {self._start_s:g} s on'
            )
        rest = (cue for cue in images if cue.stamp_ns >= begin_ns)
        sides = [_from(self._side(what), first.stamp_ns - _LEAD_NS) for what in self._sides]
        yield from heapq.merge(*sides, _after(first, rest), key=lambda cue: cue.stamp_ns)

    def _images(self) -> Iterator[Cue]:
        if isinstance(self._source, Recording):
            for message in self._source.messages():
                yield Cue(message.stamp_ns, IMAGE, _stamped(message))
            return
        for frame in self._source:
            if frame.gray is not None:
                stamp = stamp_from_ns(frame.stamp_ns)
                image = image_message(frame.gray, Header(stamp=stamp))
                yield Cue(frame.stamp_ns, IMAGE, image)

    def _side(self, what: str) -> Iterator[Cue]:
        for message in self._messages(what):
            if len(message.cdr) >= STAMP_END:
                yield Cue(message.stamp_ns, what, _stamped(message))

    def _messages(self, what: str) -> Iterator[RawMessage]:
        return messages_of(self._path, self._sides[what], *_SIDES[what], self._reading)[1]


class Timeline:
    """
    The time of the recording while it is played, from `begin_ns` on.

    `rate` is how many seconds of the recording are in a second.
    """

    def __init__(self, begin_ns: int, rate: float) -> None:
        self._begin_ns = begin_ns
        self._rate = rate
        self._started_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        """Return the time of the recording."""
        return self._begin_ns + round((time.monotonic_ns() - self._started_ns) * self._rate)


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
