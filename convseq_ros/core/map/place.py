# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The data of a place: numbers held in memory; cells, pictures and depths read on demand."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
import sys
from typing import Any

from convseq_ros.core.encoding.regions import Cells, REGION
from convseq_ros.core.graph.links import SessionBounds
from convseq_ros.core.types import constants, Doubles, Floats, Gray, Halves, Pose, Vector
from convseq_ros.io.picture_header import declared_size
import cv2
import numpy as np
import numpy.typing as npt

Packed = Halves
Depths = Doubles  # (n,), one for each region, metres along the optical axis; NaN if unknown

NO_CELLS: Packed = np.zeros((0, 0, 0), np.float16)  # of a place without stored cells
PACKED_UNIT = np.float32(64)  # divides stored cells, whose sums would overflow float16
_QUALITY = 70  # of a thumbnail's JPEG, in percent; 2 to 3 kB at 128 px
_TALLEST = 4  # largest height of a thumbnail, in multiples of `thumbnail_width_px`
_MOST_PIXELS = _TALLEST * 640**2  # of a thumbnail; 640 is the largest `thumbnail_width_px`
_GROWTH = 1.25  # factor of capacity of a full array; 20 % of it is empty at most
_FEWEST_ROWS = 64  # smallest capacity of an array that grew
_NOT_FINITE = np.uint16(0x7C00)  # exponent bits of float16; `np.isfinite` is slower
_ROW = np.dtype(
    [('stamp_ns', np.int64), ('source', object), ('pose', np.float64, 7), ('session', np.int32)]
)


@constants
class KEPT_IMAGE:
    """Constants of stored images; quality chosen on road_1 and road_2 (docs/GEOMETRY.md)."""

    quality_percent: int = 85  # of a JPEG; 70 doubles the error of poses at a corner
    longest_px: int = 1280  # longer side of an image in use; a file may hold any size


@constants
class SAMPLE:
    """Sampling of depth images; chosen by experience, not tuned."""

    grid: int = 5  # rows and columns of pixels that are read in a region's middle cell
    fewest: int = 13  # of these 25 pixels that must have a valid depth
    nearest_m: float = 0.1  # smaller depths are invalid
    furthest_m: float = 1000.0  # larger depths are invalid
    aspect: float = 0.02  # allowed relative difference from the image's aspect ratio


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

    packed: Packed  # (S, S, 8), cells from `pack_cells`, or `NO_CELLS`
    thumbnail: bytes = b''  # a small JPEG for people; empty if none was kept
    image: bytes | None = None  # the frame as a JPEG, if it was kept
    depths: bytes | None = None  # of the regions, from `packed_depths`


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
            larger = np.empty((capacity, *self._rows.shape[1:]), self._rows.dtype)
            larger[: self._count] = self.view
            self._rows = larger
        self._rows[self._count : end] = rows
        self._count = end


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
    def columns(self) -> dict[str, Any]:
        """The columns of all places without descriptors, (R, ...) each, quick to pickle."""
        rows = self._rows.view
        names = 'stamp_ns', 'pose', 'session'
        return {'source': rows['source'].tolist()} | {name: rows[name].copy() for name in names}

    def take(self, columns: Mapping[str, Any], first_session: int) -> None:
        """Add places by `columns` of another map; its sessions are numbered from a first one."""
        block = np.empty(len(columns['source']), _ROW)
        for name, column in columns.items():
            block[name] = column
        block['session'] += first_session
        self._add(block)

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


def pack_cells(cells: Cells) -> Packed:
    """Return cells in half precision, divided by 64 to avoid overflow."""
    return (cells / PACKED_UNIT).astype(np.float16)


def unpack_cells(packed: Packed) -> Cells:
    """Return packed cells as float32."""
    return np.multiply(packed, PACKED_UNIT, dtype=np.float32)


def thumbnail(gray: Gray, width_px: int) -> bytes:
    """Return an image (H, W) as a JPEG of a width, at most 4 times as high; empty for width 0."""
    if not width_px:
        return b''
    height, width = gray.shape
    scale = min(width_px / width, _TALLEST * width_px / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return _jpeg(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), _QUALITY)


def _jpeg(gray: Gray, quality_percent: int) -> bytes:
    return cv2.imencode('.jpg', gray, [cv2.IMWRITE_JPEG_QUALITY, quality_percent])[1].tobytes()


def decode_jpeg(jpeg: bytes, most_pixels: float = _MOST_PIXELS) -> Gray | None:
    """Return the image (H, W) of a JPEG; None if it is invalid or has too many pixels."""
    size = declared_size(jpeg)
    if size is None or size.pixels * size.passes > most_pixels:
        return None
    gray = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    return None if gray is None else np.asarray(gray, np.uint8)


def reduced(gray: Gray, longest_px: int) -> Gray:
    """Return an image (H, W), reduced if its longer side exceeds a length."""
    scale = longest_px / max(gray.shape)
    if scale >= 1:
        return gray
    height, width = (max(1, round(side * scale)) for side in gray.shape)
    return np.asarray(cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def encode_image(gray: Gray, width_px: int) -> bytes | None:
    """Return an image (H, W) as a JPEG, its longer side reduced to a width; None for width 0."""
    return _jpeg(reduced(gray, width_px), KEPT_IMAGE.quality_percent) if width_px else None


def decode_image(jpeg: bytes | None, max_mpx: float) -> Gray | None:
    """Return a kept image (H, W), or None without one; ValueError if too large or no JPEG."""
    if jpeg is None:
        return None
    if (gray := decode_jpeg(jpeg, max_mpx * 1e6)) is not None:
        return reduced(gray, KEPT_IMAGE.longest_px)
    raise ValueError(f'no JPEG within max_image_mpx, {max_mpx:g}; build the map again')


def packed_depths(depth_m: Floats | None, shape: tuple[int, ...], cells: int) -> bytes | None:
    """
    Return the median depth of each region's middle cell, as a map stores it.

    The depths are half floats, little-endian, 0 if unknown. `depth_m`, (h, w) in metres, may hold
    invalid depths; `shape` is the image's, (H, W), and `cells` the number of cells in a row. None
    if no depth is valid, or if the depth image has another aspect ratio than the image: it cannot
    be registered to it then.
    """
    if depth_m is None or depth_m.ndim != 2 or not depth_m.size:
        return None
    aspect, depth_aspect = shape[1] / shape[0], depth_m.shape[1] / depth_m.shape[0]
    if abs(depth_aspect - aspect) > SAMPLE.aspect * aspect:
        return None
    first, side = REGION.span // 2, cells - REGION.span + 1
    shares = (np.arange(side * SAMPLE.grid) + 0.5) / SAMPLE.grid + first
    rows, columns = ((shares / cells * length).astype(int) for length in depth_m.shape)
    pixels = depth_m[np.ix_(rows, columns)].reshape(side, SAMPLE.grid, side, SAMPLE.grid)
    samples = pixels.transpose(0, 2, 1, 3).reshape(side, side, -1).astype(np.float32)
    with np.errstate(invalid='ignore'):
        valid = (samples >= SAMPLE.nearest_m) & (samples <= SAMPLE.furthest_m)
    counts = valid.sum(axis=2)
    ranked = np.sort(np.where(valid, samples, np.float32(np.inf)), axis=2)
    median = np.take_along_axis(ranked, np.maximum(counts - 1, 0)[..., None] // 2, axis=2)
    depths = np.where(counts >= SAMPLE.fewest, median[..., 0], 0).astype('<f2')
    return depths.tobytes() if depths.any() else None


def unpacked_depths(stored: bytes | None, cells: int) -> Depths | None:
    """Return stored depths of regions, row by row, or None; ValueError if the number is wrong."""
    if stored is None:
        return None
    side = cells - REGION.span + 1
    depths = np.frombuffer(stored, '<f2').astype(np.float64)
    if len(depths) != side**2:
        raise ValueError(f'{len(depths)} depths, but {side**2} regions')
    with np.errstate(invalid='ignore'):
        is_valid = (depths >= SAMPLE.nearest_m) & (depths <= SAMPLE.furthest_m)
    return np.where(is_valid, depths, np.nan)
