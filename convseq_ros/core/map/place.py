# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of a place: numbers in memory; cells, pictures and depths that are read later."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
import sys
from typing import Any

from convseq_ros.core.encoding.regions import Cells, REGION
from convseq_ros.core.graph.links import SessionBounds
from convseq_ros.core.types import constants, Doubles, Floats, Gray, Halves, Pose, Vector
from convseq_ros.picture_header import declared
import cv2
import numpy as np
import numpy.typing as npt

Packed = Halves
Depths = Doubles  # (n,), of regions, metres along the lens; NaN where unknown

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


@constants
class KEPT_IMAGE:
    """Of kept images; quality by a look at road_1 and road_2 (docs/GEOMETRY.md)."""

    quality_percent: int = 85  # of a JPEG; 70 doubles the error of poses on a corner
    longest_px: int = 1280  # side of an image as it is used; a stranger's may be of any size


@constants
class SAMPLE:
    """Of depth images; engineering, not studied."""

    grid: int = 5  # pixels that are read across and down of a region's middle cell
    fewest: int = 13  # of the 25, that must show a depth
    nearest_m: float = 0.1  # what is nearer is no depth
    furthest_m: float = 1000.0
    aspect: float = 0.02  # by which its sides may have another ratio than the image's


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

    def __init__(self, room: npt.NDArray[Any]) -> None:
        self._rows, self._count = room, 0  # rows so far; the others are empty

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


class Places(Sequence[Place]):
    """
    What a map holds in memory of its R places; at first none, and `room` for some.

    Their global descriptors have so many numbers; 0 if the first one tells.
    """

    def __init__(self, numbers: int, room: int = 0) -> None:
        self.descriptors = GrowingArray(np.empty((room, numbers), np.float16))  # (R, n)
        self._rows = GrowingArray(np.empty(room, _ROW))
        self.bounds = SessionBounds()

    def append(self, place: Place, descriptor: npt.ArrayLike) -> None:
        """Add a place; its global descriptor has shape (n,)."""
        # The name of a file may be any bytes; a map holds text.
        source = sys.intern(place.source.encode(errors='backslashreplace').decode())
        row = place.stamp_ns, source, place.pose_numbers, place.session
        self.descriptors.extend([descriptor])
        self._add(np.array([row], _ROW))

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
        """Add rows, and take note of where sessions begin."""
        sessions = block['session']
        before = self._rows.view['session'][-1:] if len(self) else sessions[:1]
        for change in np.flatnonzero(np.diff(sessions, prepend=before)):
            self.bounds.begin(len(self) + int(change))
        self._rows.extend(block)

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
    return _jpeg(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), _QUALITY)


def _jpeg(gray: Gray, quality_percent: int) -> bytes:
    return cv2.imencode('.jpg', gray, [cv2.IMWRITE_JPEG_QUALITY, quality_percent])[1].tobytes()


def shown(jpeg: bytes, most_pixels: float = _MOST_PIXELS) -> Gray | None:
    """Return what a JPEG shows (H, W); None if there is none, or of more pixels than it may."""
    size = declared(jpeg)
    if size is None or size.pixels * size.passes > most_pixels:
        return None
    gray = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    return None if gray is None else np.asarray(gray, np.uint8)


def reduced(gray: Gray, longest_px: int) -> Gray:
    """Return an image (H, W) whose longer side is at most so long."""
    scale = longest_px / max(gray.shape)
    if scale >= 1:
        return gray
    height, width = (max(1, round(side * scale)) for side in gray.shape)
    return np.asarray(cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def kept_image(gray: Gray, width_px: int) -> bytes | None:
    """Return a JPEG of an image (H, W), its longer side reduced to a length; None if that is 0."""
    return _jpeg(reduced(gray, width_px), KEPT_IMAGE.quality_percent) if width_px else None


def used_image(jpeg: bytes | None, max_mpx: float) -> Gray | None:
    """Return a kept image (H, W), if there is one; ValueError if it is larger, or no JPEG."""
    if jpeg is None:
        return None
    if (gray := shown(jpeg, max_mpx * 1e6)) is not None:
        return reduced(gray, KEPT_IMAGE.longest_px)
    raise ValueError(f'no JPEG within max_image_mpx, {max_mpx:g}; build the map again')


def packed_depths(depth_m: Floats | None, shape: tuple[int, ...], cells: int) -> bytes | None:
    """
    Return the median depth of each region's middle cell, as a map stores it.

    That is half floats, little-endian, 0 where unknown. `depth_m`, (h, w) in metres, may hold
    what is not finite or no depth; the image has a shape of (H, W), and `cells` cells in a row.
    None if nothing is known, or if the depth image has other proportions than the image, and so
    is not registered to it.
    """
    if depth_m is None or depth_m.ndim != 2 or not depth_m.size:
        return None
    wide, own = shape[1] / shape[0], depth_m.shape[1] / depth_m.shape[0]
    if abs(own - wide) > SAMPLE.aspect * wide:
        return None
    first, side = REGION.span // 2, cells - REGION.span + 1
    shares = (np.arange(side * SAMPLE.grid) + 0.5) / SAMPLE.grid + first
    rows, columns = ((shares / cells * length).astype(int) for length in depth_m.shape)
    some = depth_m[np.ix_(rows, columns)].reshape(side, SAMPLE.grid, side, SAMPLE.grid)
    each = some.transpose(0, 2, 1, 3).reshape(side, side, -1).astype(np.float32)
    with np.errstate(invalid='ignore'):
        known = (each >= SAMPLE.nearest_m) & (each <= SAMPLE.furthest_m)
    counts = known.sum(axis=2)
    ranked = np.sort(np.where(known, each, np.float32(np.inf)), axis=2)
    median = np.take_along_axis(ranked, np.maximum(counts - 1, 0)[..., None] // 2, axis=2)
    depths = np.where(counts >= SAMPLE.fewest, median[..., 0], 0).astype('<f2')
    return depths.tobytes() if depths.any() else None


def unpacked_depths(stored: bytes | None, cells: int) -> Depths | None:
    """Return depths of regions, row by row, if known; ValueError if their number does not fit."""
    if stored is None:
        return None
    side = cells - REGION.span + 1
    depths = np.frombuffer(stored, '<f2').astype(np.float64)
    if len(depths) != side**2:
        raise ValueError(f'{len(depths)} depths, but {side**2} regions')
    with np.errstate(invalid='ignore'):
        is_known = (depths >= SAMPLE.nearest_m) & (depths <= SAMPLE.furthest_m)
    return np.where(is_known, depths, np.nan)
