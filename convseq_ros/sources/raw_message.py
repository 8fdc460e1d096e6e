# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A message as it lies in a recording, and the typestore that knows its fields."""

import functools
import struct
from typing import Any, NamedTuple

from convseq_ros.errors import ConvseqError, ImageError, pip_install

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
    """
    Return the message definitions of ROS 2 Jazzy; image and pose types are older than that.

    Raises
    ------
    ConvseqError
        If rosbags is not installed.

    """
    try:
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise ConvseqError(
            'rosbags is not installed, but recordings need it; '
            + pip_install('rosbags', 'mcap', 'zstandard')
        ) from None
    return get_typestore(Stores.ROS2_JAZZY)


def one_line(error: BaseException) -> str:
    """Return what an error says in one line; a short one, if it is of another library."""
    line = ' '.join(str(error).split())
    return (line if isinstance(error, ConvseqError) else line[:200]) or type(error).__name__
