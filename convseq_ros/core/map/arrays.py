# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of all places, in arrays that grow."""

from collections.abc import Mapping, Sequence
import math
from mmap import MAP_ANONYMOUS, MAP_PRIVATE, mmap
import sys
from typing import Any

from convseq_ros.core.graph.neighbourhood import SessionBounds
from convseq_ros.core.map.place import Place
from convseq_ros.core.types import Pose, Vector
import numpy as np
import numpy.typing as npt

_GROWTH = 1.25  # factor of capacity of a full array; 20 % of it is empty at most
_FEWEST_ROWS = 64  # smallest capacity of an array that grew
_NOT_FINITE = np.uint16(0x7C00)  # exponent bits of float16; `np.isfinite` is slower
_ROW = np.dtype(
    [('stamp_ns', np.int64), ('source', object), ('pose', np.float64, 7), ('session', np.int32)]
)


class GrowingArray:
    """An array to which one thread appends rows; views that others hold stay valid."""

    def __init__(self, room: npt.NDArray[Any]) -> None:
        self._rows, self._count = room, 0  # the first `_count` rows are filled

    def __len__(self) -> int:
        return self._count

    @property
    def view(self) -> npt.NDArray[Any]:
        """The rows so far; do not write to them."""
        return self._rows[: self._count]

    def extend(self, rows: Any) -> None:
        """Append rows."""
        end = self._count + len(rows)
        # The first row sets the number of columns.
        if self._rows.shape[1:] == (0,) and len(rows):
            self._rows = np.empty((len(self._rows), len(rows[0])), self._rows.dtype)
        if end > len(self._rows):
            capacity = max(_FEWEST_ROWS, int(self._count * _GROWTH), end)
            larger = _mapped((capacity, *self._rows.shape[1:]), self._rows.dtype)
            larger[: self._count] = self.view
            self._rows = larger
        self._rows[self._count : end] = rows
        self._count = end


def _mapped(shape: tuple[int, ...], kind: np.dtype[Any]) -> npt.NDArray[Any]:
    """Return an array that leaves no hole in the heap when a larger one takes its place."""
    if kind.hasobject:
        return np.empty(shape, kind)
    size = max(1, math.prod(shape) * kind.itemsize)
    return np.ndarray(shape, kind, mmap(-1, size, MAP_PRIVATE | MAP_ANONYMOUS))


class Places(Sequence[Place]):
    """
    The R places of a map, as far as they are in memory; at first none, with `room` for some.

    `numbers` is the length of a global descriptor; with 0, the first one sets it.
    """

    def __init__(self, numbers: int, room: int = 0) -> None:
        self.descriptors = GrowingArray(np.empty((room, numbers), np.float16))  # (R, n)
        self._rows = GrowingArray(np.empty(room, _ROW))
        self.bounds = SessionBounds()

    def append(self, place: Place, descriptor: npt.ArrayLike) -> None:
        """Add a place; its global descriptor has shape (n,)."""
        # The name of a file may be any bytes; a map stores text.
        source = sys.intern(place.source.encode(errors='backslashreplace').decode())
        row = place.stamp_ns, source, place.pose_numbers, place.session
        self.descriptors.extend([descriptor])
        self._add(np.array([row], _ROW))

    def extend(self, rows: Sequence[Sequence[Any]]) -> None:
        """Add rows of the table `places`; ValueError if a number is not finite."""
        _, stamps_ns, sources, *poses, sessions, blobs, _ = zip(*rows, strict=True)
        block = np.empty(len(rows), _ROW)
        block['stamp_ns'], block['source'] = stamps_ns, [*map(sys.intern, sources)]
        for numbers, column in zip(poses, block['pose'].T, strict=True):
            # A fast path for maps without odometry, whose poses are all unknown.
            column[:] = math.nan if numbers.count(None) == len(numbers) else numbers
        block['session'] = sessions
        if len({len(blob) for blob in blobs}) > 1:
            raise ValueError('global descriptors of several lengths')
        descriptors = np.frombuffer(b''.join(blobs), '<f2').reshape(len(rows), -1)
        finite, exponents = np.isfinite(block['pose']), descriptors.view('<u2') & _NOT_FINITE
        valid = (exponents != _NOT_FINITE).all(axis=1) & (finite.all(axis=1) | ~finite.any(axis=1))
        if not valid.all():
            raise ValueError(f'reference {len(self) + valid.argmin()} has NaN or infinity')
        self.descriptors.extend(descriptors)
        self._add(block)

    @property
    def columns(self) -> npt.NDArray[Any]:
        """The numbers of all places, (R,), by name; do not write to them."""
        return self._rows.view

    def join(
        self, other: 'Places', indices: Sequence[int], session: int, poses: Mapping[int, Pose]
    ) -> None:
        """Add places of another map to a session; some with other poses, by their index there."""
        chosen = np.array(indices, np.int64)
        rows = other.columns[chosen]
        rows['session'] = session
        for at in np.flatnonzero(np.isin(chosen, [*poses])):
            rows['pose'][at] = Place(0, pose=poses[int(chosen[at])]).pose_numbers
        self.descriptors.extend(other.descriptors.view[chosen])
        self._add(rows)

    def first(self, count: int) -> 'Places':
        """Return a copy of the first places."""
        copy = Places(self.descriptors.view.shape[1], count)
        copy.descriptors.extend(self.descriptors.view[:count])
        copy._add(self._rows.view[:count])
        return copy

    def _add(self, block: npt.NDArray[Any]) -> None:
        """Add rows, and record where sessions begin."""
        sessions = block['session']
        before = self._rows.view['session'][-1:] if len(self) else sessions[:1]
        for change in np.flatnonzero(np.diff(sessions, prepend=before)):
            self.bounds.begin(len(self) + int(change))
        self._rows.extend(block)

    def __len__(self) -> int:
        return len(self._rows)

    def position(self, index: int) -> Vector | None:
        """Return the position of a place, or None; faster than reading the place."""
        x, y, z = self._rows.view['pose'][index, :3].tolist()
        return None if math.isnan(x) else (x, y, z)

    def session(self, index: int) -> int:
        """Return the session of a place."""
        return int(self._rows.view['session'][index])

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[row] for row in range(len(self))[index]]
        stamp_ns, source, numbers, session = self._rows.view[index].item()
        x, y, z, *orientation = numbers.tolist()
        pose = None if math.isnan(x) else Pose((x, y, z), (*orientation,))
        return Place(stamp_ns, source, pose, session)
