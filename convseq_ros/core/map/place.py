# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of a place: numbers in memory, and a picture that is read when it is needed."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
import sys
from typing import Any

from convseq_ros.core.encoding.regions import Cells
from convseq_ros.core.types import Flags, Gray, Halves, Indices, Pose, Vector
from convseq_ros.picture_header import declared
import cv2
import numpy as np
import numpy.typing as npt

Packed = Halves

NO_CELLS: Packed = np.zeros((0, 0, 0), np.float16)  # of a place of which none are kept
PACKED_UNIT = np.float32(64)  # of stored cells; sums of strengths would overflow float16
_QUALITY = 70  # of a thumbnail's JPEG, in percent; 2 to 3 kB at 128 px
_TALLEST = 4  # of a thumbnail: its height, as a share of the width that was asked for
_MOST_PIXELS = _TALLEST * 640**2  # of a thumbnail; as wide as `thumbnail_width_px` may be
_GROWTH = 1.25  # of an array's room, when it is full; a fifth of it is empty at most
_FEWEST_ROWS = 64  # room of a new array
_NOT_FINITE = np.uint16(0x7C00)  # exponent of float16; NumPy's own test is slower
_ROW = np.dtype(
    [('stamp_ns', np.int64), ('source', object), ('pose', np.float64, 7), ('session', np.int32)]
)


@dataclass(frozen=True, slots=True)
class Place:
    """What is known of one place besides its picture."""

    stamp_ns: int  # when it was taken
    source: str = ''  # file name or topic
    pose: Pose | None = None  # where the camera was
    session: int = 0  # of those of its map

    @property
    def pose_numbers(self) -> tuple[float | None, ...]:
        """Position and orientation; None if they are not known, or not finite."""
        pose = self.pose
        numbers = (*pose.position, *pose.orientation) if pose else (math.nan,) * 7
        if not all(map(math.isfinite, numbers)):
            return (None,) * 7
        return tuple(float(number) + 0.0 for number in numbers)  # SQLite has no -0.0


@dataclass(frozen=True, slots=True)
class Picture:
    """What is seldom needed of a place, and large."""

    packed: Packed  # (S, S, 8), its cells, from `pack_cells`, or `NO_CELLS`
    thumbnail: bytes = b''  # a small JPEG to look at; empty if none was kept
    image: bytes | None = None  # the frame itself as a JPEG, if it was kept
    depths: bytes | None = None  # of its regions, from `packed_depths`, if they are known


class GrowingArray:
    """Rows that one thread appends; views that others took before stay as they are."""

    def __init__(self, rows: npt.NDArray[Any], count: int | None = None) -> None:
        self._rows = rows  # not copied before the array grows
        self._count = len(rows) if count is None else count  # of them; the others are room

    def __len__(self) -> int:
        return self._count

    @property
    def view(self) -> npt.NDArray[Any]:
        """The rows so far; not to be written to."""
        return self._rows[: self._count]

    def extend(self, rows: Any) -> None:
        """Add some rows."""
        end = self._count + len(rows)
        # The first row tells how many numbers there are.
        if self._rows.shape[1:] == (0,) and len(rows):
            self._rows = np.empty((len(self._rows), len(rows[0])), self._rows.dtype)
        if end > len(self._rows):
            capacity = max(_FEWEST_ROWS, int(self._count * _GROWTH), end)
            larger = np.empty((capacity, *self._rows.shape[1:]), self._rows.dtype)
            larger[: self._count] = self.view
            self._rows = larger
        self._rows[self._count : end] = rows
        self._count = end


class SessionBounds:
    """
    The bounds of a map's sessions, which lie one after another; at first one that begins at 0.

    Places of different sessions are not near each other, whatever their numbers. One thread may
    begin sessions while others ask.
    """

    def __init__(self, starts: tuple[int, ...] = ()) -> None:
        self._starts, self.starts = [0], np.zeros(1, np.int64)  # (S,), ascending
        for start in starts:
            self.begin(start)

    def begin(self, start: int) -> None:
        """Have a session begin at a place that comes after all sessions so far."""
        if start > self._starts[-1]:
            self._starts.append(start)
            self.starts = np.array(self._starts, np.int64)

    def span(self, index: int) -> tuple[int, int]:
        """Return the first place of a place's session, and the next one's; the last has no end."""
        after = bisect_right(self._starts, index)
        end = self._starts[after] if after < len(self._starts) else sys.maxsize
        return self._starts[after - 1], end

    def spans(self, indices: Indices) -> tuple[Indices, Indices] | tuple[int, int]:
        """Return the same of places (n,)."""
        if len(self._starts) == 1:
            return 0, sys.maxsize
        after = np.searchsorted(self.starts, indices, 'right')
        return self.starts[after - 1], np.append(self.starts, sys.maxsize)[after]

    def around(self, index: int, distance: int) -> range:
        """Return the places of the same session within a distance, and perhaps beyond the map."""
        first, end = self.span(index)
        return range(max(first, index - distance), min(end, index + distance + 1))

    def near(self, indices: Indices, index: int, distance: int) -> Flags:
        """Return which of some places (n,) are of the same session, within a distance."""
        there = self.around(index, distance)
        return (indices >= there.start) & (indices < there.stop)

    def nearness(self, indices: Indices, others: Indices, distance: int) -> Flags:
        """Return the same of some places (n,) for each of others (m,), as (m, n)."""
        apart = abs(indices - others[:, None])
        first, end = (np.broadcast_to(one, others.shape)[:, None] for one in self.spans(others))
        return (apart <= distance) & (indices >= first) & (indices < end)


class Places(Sequence[Place]):
    """
    What a map holds in memory of its R places; at first none, and `room` for some.

    Their global descriptors have so many numbers; 0 if the first one tells.
    """

    def __init__(self, numbers: int, room: int = 0) -> None:
        self.descriptors = GrowingArray(np.empty((room, numbers), np.float16), 0)  # (R, n)
        self._rows = GrowingArray(np.empty(room, _ROW), 0)
        self.bounds = SessionBounds()

    def append(self, place: Place, descriptor: npt.ArrayLike) -> None:
        """Add a place; its global descriptor has shape (n,)."""
        # The name of a file may be any bytes; a map holds text.
        source = sys.intern(place.source.encode(errors='backslashreplace').decode())
        self._begin_sessions(np.array([place.session]))
        self.descriptors.extend([descriptor])
        self._rows.extend([(place.stamp_ns, source, place.pose_numbers, place.session)])

    def extend(self, rows: Sequence[Sequence[Any]]) -> None:
        """Add rows of the table `places`; ValueError if a number of them is not finite."""
        _, stamps_ns, sources, *poses, sessions, blobs, _ = zip(*rows, strict=True)
        block = np.empty(len(rows), _ROW)
        block['stamp_ns'], block['source'] = stamps_ns, [*map(sys.intern, sources)]
        for numbers, column in zip(poses, block['pose'].T, strict=True):
            # All unknown, as in maps without odometry, needs no number read one by one.
            column[:] = math.nan if numbers.count(None) == len(numbers) else numbers
        block['session'] = sessions
        if len({len(blob) for blob in blobs}) > 1:
            raise ValueError('global descriptors of several lengths')
        descriptors = np.frombuffer(b''.join(blobs), '<f2').reshape(len(rows), -1)
        known, exponents = np.isfinite(block['pose']), descriptors.view('<u2') & _NOT_FINITE
        sound = (exponents != _NOT_FINITE).all(axis=1) & (known.all(axis=1) | ~known.any(axis=1))
        if not sound.all():
            raise ValueError(f'reference {len(self) + sound.argmin()} has numbers without a value')
        self.descriptors.extend(descriptors)
        self._add(block)

    @property
    def columns(self) -> dict[str, Any]:
        """All that is known of places but their descriptors, (R, ...) each, quick to pickle."""
        rows = self._rows.view
        names = 'stamp_ns', 'pose', 'session'
        return {'source': rows['source'].tolist()} | {name: rows[name].copy() for name in names}

    def take(self, columns: Mapping[str, Any], first_session: int) -> None:
        """Add such places, of another map; their sessions count from one of these on."""
        block = np.empty(len(columns['source']), _ROW)
        for name, column in columns.items():
            block[name] = column
        block['session'] += first_session
        self._add(block)

    def _add(self, block: npt.NDArray[Any]) -> None:
        self._begin_sessions(block['session'])
        self._rows.extend(block)

    def _begin_sessions(self, sessions: npt.NDArray[np.integer[Any]]) -> None:
        """Take note of where the sessions of more places begin."""
        before = self._rows.view['session'][-1:] if len(self) else sessions[:1]
        for change in np.flatnonzero(np.diff(sessions, prepend=before)):
            self.bounds.begin(len(self) + int(change))

    def __len__(self) -> int:
        return len(self._rows)

    def position(self, index: int) -> Vector | None:
        """Return where the camera was at a place, if it is known; quicker than the whole place."""
        x, y, z = self._rows.view['pose'][index, :3].tolist()
        return None if math.isnan(x) else (x, y, z)

    def session(self, index: int) -> int:
        """Return the session of a place."""
        return int(self._rows.view['session'][index])

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[each] for each in range(len(self))[index]]
        stamp_ns, source, numbers, session = self._rows.view[index].item()
        x, y, z, *orientation = numbers.tolist()
        pose = None if math.isnan(x) else Pose((x, y, z), (*orientation,))
        return Place(stamp_ns, source, pose, session)


def pack_cells(cells: Cells) -> Packed:
    """Return cells in half precision, divided by 64 so that none overflows."""
    return (cells / PACKED_UNIT).astype(np.float16)


def unpack_cells(packed: Packed) -> Cells:
    """Return the float32 cells of packed ones."""
    return np.multiply(packed, PACKED_UNIT, dtype=np.float32)


def thumbnail(gray: Gray, width_px: int) -> bytes:
    """Return a JPEG of an image (H, W), of a width, at most 4 times as high; empty if it is 0."""
    if not width_px:
        return b''
    height, width = gray.shape
    scale = min(width_px / width, _TALLEST * width_px / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode('.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()


def shown(jpeg: bytes, most_pixels: float = _MOST_PIXELS) -> Gray | None:
    """Return what a JPEG shows (H, W); None if there is none, or of more pixels than it may."""
    size = declared(jpeg)
    if size is None or size.pixels * size.passes > most_pixels:
        return None
    gray = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    return None if gray is None else np.asarray(gray, np.uint8)
