# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reference map: places in the order in which they were driven past."""

from collections.abc import Sequence
import sys
from threading import Lock
from typing import overload

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.encoding.descriptor import cell_shape
from convseq_ros.core.encoding.regions import Cells, global_descriptor
from convseq_ros.core.map.growing_array import GrowingArray
from convseq_ros.core.map.place import (
    Columns,
    empty_columns,
    pack_cells,
    Packed,
    Picture,
    Pictures,
    Place,
    pose_numbers,
    unpack_cells,
)
from convseq_ros.core.map.thumbnail import thumbnail
from convseq_ros.core.types import Descriptor, Frame, Pose
import numpy as np
import numpy.typing as npt


class ReferenceMap:
    """
    Places and their cells, index by index.

    Cells are held as they are stored, in half precision, so that a map answers alike before it is
    saved and after it is opened. Those in a file are read when they are asked for, and not
    remembered. One thread may add places while others read: what has an index is complete.

    Parameters
    ----------
    encoding : EncodingConfig
        How its images were encoded.
    columns : Columns, optional
        What is known of places whose pictures are stored; none by default.
    pictures : Pictures, optional
        Where these are stored.
    keyframes : KeyframeConfig
        How far apart its places are, and with them the frames that are matched.

    Notes
    -----
    A place takes about 0.6 kB of memory, and 16 kB more until it is stored.

    """

    def __init__(
        self,
        encoding: EncodingConfig = EncodingConfig(),
        columns: Columns | None = None,
        pictures: Pictures | None = None,
        keyframes: KeyframeConfig = KeyframeConfig(),
    ) -> None:
        self.encoding, self.keyframes = encoding, keyframes
        self.cell_shape = cell_shape(encoding.image_size_px)
        columns = columns or empty_columns(self.cell_shape)
        self._stamps_ns = GrowingArray(columns.stamps_ns)
        self._sources = columns.sources
        self._poses = GrowingArray(columns.poses)
        self._global_descriptors = GrowingArray(columns.global_descriptors)
        self._pictures, self._stored = pictures, len(self._global_descriptors)
        self._in_memory: list[Picture] = []
        self._moving = Lock()

    @property
    def places(self) -> Sequence[Place]:
        """What is known of each place besides its picture, made when it is asked for."""
        return _Places(self)

    def __len__(self) -> int:
        return len(self._global_descriptors)

    @property
    def global_descriptors(self) -> npt.NDArray[np.float16]:
        """Of all places, shape (R, n); not to be written to."""
        return self._global_descriptors.view

    def add_frame(self, frame: Frame, descriptor: Descriptor, thumbnail_width_px: int = 0) -> None:
        """Append the place that a frame shows: the one way from a frame to a place."""
        small = b'' if frame.gray is None else thumbnail(frame.gray, thumbnail_width_px)
        place = Place(frame.stamp_ns, frame.source, frame.pose)
        self.add(place, pack_cells(descriptor.cells), small)

    def add(
        self,
        place: Place,
        packed: Packed,
        thumbnail: bytes = b'',
        known_descriptor: npt.ArrayLike | None = None,
    ) -> None:
        """Append a place, with its global descriptor (n,) where that is known already."""
        if packed.shape != self.cell_shape or packed.dtype != np.float16:
            raise ValueError(
                f'expected {self.cell_shape} float16, got {packed.shape} {packed.dtype}'
            )
        if known_descriptor is None:
            known_descriptor = global_descriptor(unpack_cells(packed))
        self._in_memory.append(Picture(packed, thumbnail))
        self._sources.append(sys.intern(place.source))
        self._stamps_ns.append(place.stamp_ns)
        self._poses.append(pose_numbers(place.pose))
        self._global_descriptors.append(known_descriptor)

    def place(self, index: int) -> Place:
        """Return what is known of a place."""
        numbers = self._poses.view[index].tolist()
        pose = None if np.isnan(numbers[0]) else Pose(tuple(numbers[:3]), tuple(numbers[3:]))
        return Place(int(self._stamps_ns.view[index]), self._sources[index], pose)

    def picture(self, index: int) -> Picture:
        """Return what is large of a place; MapError if it is stored and damaged."""
        return self._pictures_of([index])[0]

    def packed(self, index: int) -> Packed:
        """Return the packed cells of a place; fails as `picture` does."""
        return self.picture(index).packed

    def cells(self, index: int) -> Cells:
        """Return the cells of a place, float32 of shape `cell_shape`; fails as `picture` does."""
        return unpack_cells(self.packed(index))

    def cells_of(self, indices: Sequence[int]) -> list[Cells]:
        """Return what `cells` does for several places, which are read in one go."""
        return [unpack_cells(one.packed) for one in self._pictures_of(indices)]

    def thumbnail(self, index: int) -> bytes:
        """Return the JPEG of a place, empty if it has none; fails as `picture` does."""
        return self.picture(index).thumbnail

    def evict(self, count: int, pictures: Pictures) -> None:
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
