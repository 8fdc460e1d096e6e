# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reference map: places in the order in which they were driven past."""

from collections.abc import Sequence
from dataclasses import dataclass
import sys
from threading import Lock
from typing import overload, Protocol

from convseq_ros.config import EncodingConfig, EVERY_FRAME, KeyframeConfig
from convseq_ros.core.compiled import available
from convseq_ros.core.encoding.global_descriptor import pooled, pooled_length
from convseq_ros.core.encoding.hog import BINS, CELL_PX
from convseq_ros.core.map.growing_array import GrowingArray
from convseq_ros.core.types import Pose
import numpy as np
import numpy.typing as npt

_SCALE = np.float32(64.0)
_POSE_NUMBERS = 7


@dataclass(frozen=True, slots=True)
class Place:
    """
    What is known of one reference besides its pictures.

    Parameters
    ----------
    stamp_ns : int
        When it was taken, nanoseconds.
    source : str
        File name or topic.
    pose : Pose, optional
        Where the camera was.

    """

    stamp_ns: int
    source: str = ''
    pose: Pose | None = None


@dataclass(frozen=True, slots=True)
class Columns:
    """
    What a map holds in memory of its places.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (R,)
    sources : list of R str
    poses : ndarray of float64, shape (R, 7)
        Position and orientation; NaN where it is not known.
    pooled : ndarray of float16, shape (R, n)
        What each looks like at first sight; see `pooled`.

    """

    stamps_ns: npt.NDArray[np.int64]
    sources: list[str]
    poses: npt.NDArray[np.float64]
    pooled: npt.NDArray[np.float16]


@dataclass(frozen=True, slots=True)
class Picture:
    """
    What is seldom needed of a place, and large.

    Parameters
    ----------
    packed : ndarray of float16, shape (S, S, 8)
        Its cells, from `pack_cells`.
    thumbnail : bytes
        A small JPEG to look at; empty if none was kept.

    """

    packed: npt.NDArray[np.float16]
    thumbnail: bytes = b''


class Pictures(Protocol):
    """Where the pictures of places are, if not in memory."""

    def pictures(self, indices: Sequence[int]) -> list[Picture]:
        """Return those of places."""


def pack_cells(cells: npt.NDArray[np.float32]) -> npt.NDArray[np.float16]:
    """Return cell histograms in half precision, divided by 64 so that none overflows."""
    return (cells / _SCALE).astype(np.float16)


def unpack_cells(packed: npt.NDArray[np.float16]) -> npt.NDArray[np.float32]:
    """Return the float32 histograms of packed ones."""
    if available():
        from convseq_ros.core.map.cell_kernels import widen

        cells = np.empty(packed.shape, np.float32)
        widen(packed.reshape(-1).view(np.uint16), _SCALE, cells.reshape(-1))
        return cells
    return packed.astype(np.float32) * _SCALE


class ReferenceMap:
    """
    Places and their cell histograms, index by index.

    Cells are kept as they are stored, in half precision, so that a map answers alike before it was
    saved and after it was opened. Those that are in a file are read when they are asked for, and
    not remembered. One thread may add places while others read: what has an index is complete.

    Parameters
    ----------
    encoding : EncodingConfig
        How its images were encoded.
    columns : Columns, optional
        What is known of places whose pictures are stored; none by default.
    pictures : Pictures, optional
        Where these are stored.
    keyframes : KeyframeConfig
        How far apart its places are, and with them what is matched; every frame by default.

    Notes
    -----
    A place takes about 0.6 kB of memory, and 16 kB more until it is stored.

    """

    def __init__(
        self,
        encoding: EncodingConfig = EncodingConfig(),
        columns: Columns | None = None,
        pictures: Pictures | None = None,
        keyframes: KeyframeConfig = EVERY_FRAME,
    ) -> None:
        self.encoding = encoding
        self.keyframes = keyframes
        columns = columns or empty_columns(self.cell_shape)
        self._stamps_ns = GrowingArray(columns.stamps_ns)
        self._sources = columns.sources
        self._poses = GrowingArray(columns.poses)
        self._pooled = GrowingArray(columns.pooled)
        self._pictures = pictures
        self._stored = len(self._pooled)
        self._in_memory: list[Picture] = []
        self._moving = Lock()

    @property
    def places(self) -> Sequence[Place]:
        """What is known of each reference besides its picture, made when it is asked for."""
        return _Places(self)

    def __len__(self) -> int:
        return len(self._pooled)

    @property
    def cell_shape(self) -> tuple[int, int, int]:
        """Rows, columns and bins of a place's cells."""
        side = self.encoding.image_size_px // CELL_PX
        return side, side, BINS

    @property
    def pooled(self) -> npt.NDArray[np.float16]:
        """What each place looks like at first sight, shape (R, n); not to be written to."""
        return self._pooled.view

    def add(
        self,
        place: Place,
        packed: npt.NDArray[np.float16],
        thumbnail: bytes = b'',
        first_sight: npt.ArrayLike | None = None,
    ) -> None:
        """
        Append a place.

        Parameters
        ----------
        place : Place
            What is known of it.
        packed : ndarray of float16, shape `cell_shape`
            Its cells, from `pack_cells`.
        thumbnail : bytes
            A small JPEG to look at; empty if none was kept.
        first_sight : array of shape (n,), optional
            Its entry of `pooled`, where that is known already.

        """
        if packed.shape != self.cell_shape or packed.dtype != np.float16:
            raise ValueError(
                f'expected {self.cell_shape} float16, got {packed.shape} {packed.dtype}'
            )
        if first_sight is None:
            first_sight = pooled(unpack_cells(packed))
        self._in_memory.append(Picture(packed, thumbnail))
        self._sources.append(sys.intern(place.source))
        self._stamps_ns.append(place.stamp_ns)
        self._poses.append(pose_numbers(place.pose))
        self._pooled.append(first_sight)

    def place(self, index: int) -> Place:
        """Return what is known of a place."""
        numbers = self._poses.view[index].tolist()
        pose = None if np.isnan(numbers[0]) else Pose(tuple(numbers[:3]), tuple(numbers[3:]))
        return Place(int(self._stamps_ns.view[index]), self._sources[index], pose)

    def packed(self, index: int) -> npt.NDArray[np.float16]:
        """
        Return the packed cells of a place.

        Raises
        ------
        MapError
            If they are stored and damaged.

        """
        return self._pictures_of([index])[0].packed

    def cells(self, index: int) -> npt.NDArray[np.float32]:
        """Return the cells of a place, float32 of shape `cell_shape`; fails as `packed` does."""
        return unpack_cells(self.packed(index))

    def cells_of(self, indices: Sequence[int]) -> list[npt.NDArray[np.float32]]:
        """Return what `cells` does for several places, which are read in one go."""
        return [unpack_cells(one.packed) for one in self._pictures_of(indices)]

    def thumbnail(self, index: int) -> bytes:
        """Return the JPEG of a place, empty if it has none; fails as `packed` does."""
        return self._pictures_of([index])[0].thumbnail

    def let_go(self, count: int, pictures: Pictures) -> None:
        """Rely on what is stored of the first places, instead of holding it in memory."""
        with self._moving:
            del self._in_memory[: max(0, count - self._stored)]
            self._stored, self._pictures = count, pictures

    def _pictures_of(self, indices: Sequence[int]) -> list[Picture]:
        for index in indices:
            if not 0 <= index < len(self):
                raise IndexError(f'reference {index} of {len(self)}')
        with self._moving:
            pictures, stored = self._pictures, self._stored
            found = {
                index: self._in_memory[index - stored] for index in indices if index >= stored
            }
        missing = [index for index in indices if index not in found]
        if pictures and missing:
            found.update(zip(missing, pictures.pictures(missing), strict=True))
        return [found[index] for index in indices]


class _Places(Sequence[Place]):
    """The places of a map, made when they are asked for."""

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map

    def __len__(self) -> int:
        return len(self._map)

    @overload
    def __getitem__(self, index: int) -> Place: ...

    @overload
    def __getitem__(self, index: slice) -> list[Place]: ...

    def __getitem__(self, index: int | slice) -> Place | list[Place]:
        which = range(len(self))[index]
        if isinstance(which, range):
            return [self._map.place(each) for each in which]
        return self._map.place(which)


def pose_numbers(pose: Pose | None) -> tuple[float, ...]:
    """Return position and orientation in one tuple; NaN for none."""
    return (*pose.position, *pose.orientation) if pose else (np.nan,) * _POSE_NUMBERS


def empty_columns(cell_shape: tuple[int, int, int], count: int = 0) -> Columns:
    """Return room for some places, all of it but for the sources."""
    return Columns(
        np.empty(count, np.int64),
        [],
        np.empty((count, _POSE_NUMBERS)),
        np.empty((count, pooled_length(cell_shape)), np.float16),
    )
