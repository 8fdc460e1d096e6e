# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reference map in memory: places in the order in which they were driven past."""

from dataclasses import dataclass

from convseq_ros.config import EncodingConfig
from convseq_ros.core.hog import BINS, CELL_PX
from convseq_ros.core.types import Pose
import numpy as np
import numpy.typing as npt

_SCALE = np.float32(64.0)


@dataclass(frozen=True, slots=True)
class Place:
    """
    What is known of one reference besides its cells.

    Parameters
    ----------
    stamp_ns : int
        When it was taken, nanoseconds.
    source : str
        File name or topic.
    pose : Pose, optional
        Where the camera was.
    thumbnail : bytes
        A small JPEG to look at; empty if none was kept.

    """

    stamp_ns: int
    source: str = ''
    pose: Pose | None = None
    thumbnail: bytes = b''


def pack_cells(cells: npt.NDArray[np.float32]) -> npt.NDArray[np.float16]:
    """Return cell histograms in half precision, divided by 64 so that none overflows."""
    return (cells / _SCALE).astype(np.float16)


def unpack_cells(packed: npt.NDArray[np.float16]) -> npt.NDArray[np.float32]:
    """Return the float32 histograms of packed ones."""
    return packed.astype(np.float32) * _SCALE


class ReferenceMap:
    """
    Places and their cell histograms, index by index.

    Cells are held as they are stored, in half precision, so that a map answers alike before it was
    saved and after it was opened.

    Parameters
    ----------
    encoding : EncodingConfig
        How its images were encoded.

    """

    def __init__(self, encoding: EncodingConfig = EncodingConfig()) -> None:
        self.encoding = encoding
        self.places: list[Place] = []
        self._cells: list[npt.NDArray[np.float16]] = []

    def __len__(self) -> int:
        return len(self.places)

    @property
    def cell_shape(self) -> tuple[int, int, int]:
        """Rows, columns and bins of a place's cells."""
        side = self.encoding.image_size_px // CELL_PX
        return side, side, BINS

    def add(self, place: Place, packed: npt.NDArray[np.float16]) -> None:
        """
        Append a place.

        Parameters
        ----------
        place : Place
            What is known of it.
        packed : ndarray of float16, shape `cell_shape`
            Its cells, from `pack_cells`.

        """
        if packed.shape != self.cell_shape or packed.dtype != np.float16:
            raise ValueError(
                f'expected {self.cell_shape} float16, got {packed.shape} {packed.dtype}'
            )
        self.places.append(place)
        self._cells.append(packed)

    def packed(self, index: int) -> npt.NDArray[np.float16]:
        """Return the stored cells of a place."""
        return self._cells[index]

    def cells(self, index: int) -> npt.NDArray[np.float32]:
        """Return the cells of a place, float32 of shape `cell_shape`."""
        return unpack_cells(self._cells[index])
