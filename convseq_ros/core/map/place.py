# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A place: its numbers, held in memory, and its picture, read on demand."""

from dataclasses import dataclass
import math

from convseq_ros.core.encoding.regions import Cells
from convseq_ros.core.types import Halves, Pose
import numpy as np

Packed = Halves

PACKED_UNIT = np.float32(64)  # divides stored cells, whose sums would overflow float16


@dataclass(frozen=True, slots=True)
class Place:
    """The numbers of a place, which are held in memory."""

    stamp_ns: int  # of the image
    source: str = ''  # file name or topic
    pose: Pose | None = None  # of the robot's base
    session: int = 0  # index in the map's `sessions`

    @property
    def pose_numbers(self) -> tuple[float | None, ...]:
        """Position and orientation, 7 numbers; all None if unknown or not finite."""
        pose = self.pose
        numbers = (*pose.position, *pose.orientation) if pose else (math.nan,) * 7
        if not all(map(math.isfinite, numbers)):
            return (None,) * 7
        return tuple(float(number) + 0.0 for number in numbers)  # SQLite has no -0.0


@dataclass(frozen=True, slots=True)
class Picture:
    """The large data of a place, which are seldom needed."""

    packed: Packed  # (S, S, 8), cells from `pack_cells`
    thumbnail: bytes = b''  # a small JPEG for people; empty if none was kept
    keypoints: bytes = b''  # as `encoding.keypoints` stores them; empty if none were kept
    image: bytes | None = None  # the frame as a JPEG, if it was kept


def pack_cells(cells: Cells) -> Packed:
    """Return cells in half precision, divided by 64 to avoid overflow."""
    return (cells / PACKED_UNIT).astype(np.float16)


def unpack_cells(packed: Packed) -> Cells:
    """Return packed cells as float32."""
    return np.multiply(packed, PACKED_UNIT, dtype=np.float32)
