# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a map keeps of places beside cells: images as JPEGs, for keypoints, and depths."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from weakref import WeakMethod

from convseq_ros.core.encoding.regions import REGION
from convseq_ros.core.map.place import Picture, shown
from convseq_ros.core.types import constants, Doubles, Floats, Gray
from convseq_ros.errors import MapError
import cv2
import numpy as np

Depths = Doubles  # (n,), of regions, metres along the lens; NaN where unknown


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


def reduced(gray: Gray, longest_px: int) -> Gray:
    """Return an image (H, W) whose longer side is at most so long."""
    scale = longest_px / max(gray.shape)
    if scale >= 1:
        return gray
    height, width = (max(1, round(side * scale)) for side in gray.shape)
    return np.asarray(cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def kept_image(gray: Gray, width_px: int) -> bytes | None:
    """Return a JPEG of an image (H, W), its longer side reduced to a length; None if that is 0."""
    if not width_px:
        return None
    how = [cv2.IMWRITE_JPEG_QUALITY, KEPT_IMAGE.quality_percent]
    return cv2.imencode('.jpg', reduced(gray, width_px), how)[1].tobytes()


class KeptImages:
    """
    The images and depths of a map, by its `pictures`; read only if any `are_kept`.

    Of what could not be decoded, `unreadable` is how often, and `problem` why the last could not.
    """

    def __init__(
        self, pictures: Callable[[Sequence[int], bool], list[Picture]], are_kept: bool = True
    ) -> None:
        # Not held, so that a map that is let go of is gone at once.
        self._pictures, self.are_kept = WeakMethod(pictures), are_kept
        self.unreadable, self.problem = 0, ''

    def _read(self, index: int) -> tuple[bytes | None, bytes | None]:
        """Return the image of a place and its depths, as far as they were kept."""
        pictures = self._pictures() if self.are_kept else None
        if pictures is None:
            return None, None
        (picture,) = pictures([index], True)
        return picture.image, picture.depths

    def image(self, index: int, max_mpx: float) -> Gray | None:
        """Return the image of a place; None if none was kept, or it cannot be decoded."""
        with self._counted('image', index):
            jpeg, _ = self._read(index)
            if jpeg is None:
                return None
            if (gray := shown(jpeg, max_mpx * 1e6)) is not None:
                return reduced(gray, KEPT_IMAGE.longest_px)
            raise ValueError(f'no JPEG within max_image_mpx, {max_mpx:g}; build the map again')
        return None

    def depths(self, index: int, cells: int) -> Depths | None:
        """Return the depths of a place's regions; None if none are known, or they are damaged."""
        with self._counted('depth', index):
            _, stored = self._read(index)
            if stored is not None:
                return unpacked_depths(stored, cells)
        return None

    @contextmanager
    def _counted(self, what: str, index: int) -> Iterator[None]:
        try:
            yield
        except (MapError, ValueError, cv2.error) as error:
            self.unreadable += 1
            self.problem = f'kept {what} of reference {index}: {error}'


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


def unpacked_depths(stored: bytes, cells: int) -> Depths:
    """Return depths of regions, row by row; ValueError if their number does not fit."""
    side = cells - REGION.span + 1
    depths = np.frombuffer(stored, '<f2').astype(np.float64)
    if len(depths) != side**2:
        raise ValueError(f'{len(depths)} depths, but {side**2} regions')
    with np.errstate(invalid='ignore'):
        is_known = (depths >= SAMPLE.nearest_m) & (depths <= SAMPLE.furthest_m)
    return np.where(is_known, depths, np.nan)
