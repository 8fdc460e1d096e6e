# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Serialized messages (CDR) as they are sent and recorded, and the fields of images.

General deserializers copy an image of a megabyte twice, or take a tenth of a second to start. That
is too long for 30 images a second, and for the start of the node.
"""

import struct
from typing import NamedTuple

from convseq_ros.errors import ImageError, one_line

IMAGE, COMPRESSED_IMAGE = IMAGE_TYPES = (
    'sensor_msgs/msg/Image',
    'sensor_msgs/msg/CompressedImage',
)
# What to do with a topic of video, or of pictures that are not read.
REPUBLISH = 'is video, or a picture that is not read: republish it (image_transport republish)'
MAX_STAMP_NS = 2**63 - 1
_HEADER_END = 4  # bytes that give the byte order; fields are aligned from there on
STAMP_END = 12  # end of seconds and nanoseconds, with which a std_msgs/Header starts


class ImageMessage(NamedTuple):
    """A sensor_msgs/Image without its header."""

    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: memoryview  # bytes of the message


class CompressedMessage(NamedTuple):
    """A sensor_msgs/CompressedImage without its header."""

    format: str
    data: memoryview  # bytes of the message


class RawMessage(NamedTuple):
    """One serialized message."""

    log_time_ns: int  # when it was recorded; 0 if it was not
    type_name: str  # such as sensor_msgs/msg/Image
    cdr: bytes  # as rclpy publishes it; empty if it was too damaged to convert

    @property
    def header_stamp_ns(self) -> int:
        """Stamp of a message that starts with a std_msgs/Header; 0 if unset or unreadable."""
        if len(self.cdr) < STAMP_END:
            return 0
        seconds, nanoseconds = struct.unpack_from(f'{_order(self.cdr)}iI', self.cdr, _HEADER_END)
        return int(seconds) * 1_000_000_000 + int(nanoseconds)

    @property
    def frame_id(self) -> str:
        """Frame of a message that starts with a std_msgs/Header; empty if unreadable."""
        fields = _Fields(self.cdr)
        try:
            fields.numbers(2)  # the stamp
            return fields.text()
        except (struct.error, IndexError, ValueError):
            return ''

    @property
    def stamp_ns(self) -> int:
        """Stamp of the header; if that is unset, the time of recording."""
        return self.header_stamp_ns or min(self.log_time_ns, MAX_STAMP_NS)

    def without_stamp(self) -> 'RawMessage':
        """Return the message without a stamp in its header: its time of recording counts."""
        start, end = self.cdr[:_HEADER_END], self.cdr[STAMP_END:]
        return self._replace(cdr=start + bytes(STAMP_END - _HEADER_END) + end)

    def image(self) -> ImageMessage | CompressedMessage:
        """Return the fields of a message of `IMAGE_TYPES`; ImageError if it is damaged."""
        fields = _Fields(self.cdr)
        try:
            fields.numbers(2)  # the stamp
            fields.text()  # the frame
            if self.type_name == COMPRESSED_IMAGE:
                return CompressedMessage(fields.text(), fields.sequence())
            (height, width), encoding = fields.numbers(2), fields.text()
            is_bigendian, (step,) = fields.octet(), fields.numbers(1)
            return ImageMessage(height, width, encoding, is_bigendian, step, fields.sequence())
        except (struct.error, IndexError, ValueError) as error:
            raise damaged(self, error) from None


def damaged(message: RawMessage, error: Exception) -> ImageError:
    """Return the error for a message that cannot be read."""
    size, kind = len(message.cdr), message.type_name
    return ImageError(f'a {kind} of {size} bytes is damaged ({one_line(error)})')


class _Fields:
    """Reads the fields of a message one after another."""

    def __init__(self, cdr: bytes) -> None:
        self._bytes, self._at = memoryview(cdr)[_HEADER_END:], 0
        self._order = _order(cdr)

    def numbers(self, count: int) -> tuple[int, ...]:
        first = -(-self._at // 4) * 4
        values = struct.unpack_from(f'{self._order}{count}I', self._bytes, first)
        self._at = first + 4 * count
        return values

    def octet(self) -> int:
        self._at += 1
        return self._bytes[self._at - 1]

    def sequence(self) -> memoryview:
        (count,) = self.numbers(1)
        first, self._at = self._at, self._at + count
        if self._at > len(self._bytes):
            raise ValueError(f'{len(self._bytes) - first} of {count} bytes are there')
        return self._bytes[first : self._at]

    def text(self) -> str:
        return bytes(self.sequence()[:-1]).decode()


def _order(cdr: bytes) -> str:
    return '<' if len(cdr) > 1 and cdr[1] & 1 else '>'
