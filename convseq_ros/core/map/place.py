# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of a place: in memory, and in pictures that are read when they are needed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.encoding.regions import Cells, global_descriptor_length
from convseq_ros.core.types import Pose
import numpy as np
import numpy.typing as npt

Packed = npt.NDArray[np.float16]

_SCALE = np.float32(64.0)  # of stored cells; sums of strengths would overflow float16 otherwise
_POSE_NUMBERS = 7  # position and quaternion


@dataclass(frozen=True, slots=True)
class Place:
    """What is known of one place besides its picture."""

    stamp_ns: int  # when it was taken
    source: str = ''  # file name or topic
    pose: Pose | None = None  # where the camera was


@dataclass(frozen=True, slots=True)
class Columns:
    """What a map holds in memory of its R places."""

    stamps_ns: npt.NDArray[np.int64]  # (R,)
    sources: list[str]
    poses: npt.NDArray[np.float64]  # (R, 7), position and orientation; NaN where not known
    global_descriptors: npt.NDArray[np.float16]  # (R, n)


@dataclass(frozen=True, slots=True)
class Picture:
    """What is seldom needed of a place, and large."""

    packed: Packed  # (S, S, 8), its cells, from `pack_cells`
    thumbnail: bytes = b''  # a small JPEG to look at; empty if none was kept


class Pictures(Protocol):
    """Where the pictures of places are, if not in memory."""

    def pictures(self, indices: Sequence[int]) -> list[Picture]:
        """Return those of places."""


def pack_cells(cells: Cells) -> Packed:
    """Return cells in half precision, divided by 64 so that none overflows."""
    return (cells / _SCALE).astype(np.float16)


def unpack_cells(packed: Packed) -> Cells:
    """Return the float32 cells of packed ones."""
    cells = np.empty(packed.shape, np.float32)
    bits = packed.reshape(-1).view(np.uint16)
    kernels_of(__package__).widen(bits, _SCALE, cells.reshape(-1))
    return cells


def pose_numbers(pose: Pose | None) -> tuple[float, ...]:
    """Return position and orientation in one tuple; NaN for none."""
    return (*pose.position, *pose.orientation) if pose else (np.nan,) * _POSE_NUMBERS


def empty_columns(cell_shape: tuple[int, int, int], count: int = 0) -> Columns:
    """Return room for some places, all of it but for the sources."""
    descriptors = np.empty((count, global_descriptor_length(cell_shape)), np.float16)
    return Columns(np.empty(count, np.int64), [], np.empty((count, _POSE_NUMBERS)), descriptors)
