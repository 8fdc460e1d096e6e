# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How deep the regions of a place lie, by a depth image that is registered to the camera."""

from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.regions import REGION
import numpy as np
import numpy.typing as npt

Depths = npt.NDArray[np.float64]  # (n,), of regions, metres along the lens; NaN where unknown


@constants
class SAMPLE:
    """Of depth images; engineering, not studied."""

    grid: int = 5  # pixels that are read across and down of a region's middle cell
    fewest: int = 13  # of the 25, that must tell a depth
    nearest_m: float = 0.1  # what is nearer is no depth
    furthest_m: float = 1000.0
    aspect: float = 0.02  # by which its sides may have another ratio than the image's


def packed_depths(
    depth_m: npt.NDArray[np.float32] | None, shape: tuple[int, ...], cells: int
) -> bytes | None:
    """
    Return the median depth of each region's middle cell, as a map stores it.

    That is half floats, little-endian, 0 where unknown. `depth_m`, (h, w) in metres, may hold
    what is not finite or no depth; the image has a shape of (H, W), and so many cells in a row.
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
    told = np.where(counts >= SAMPLE.fewest, median[..., 0], 0).astype('<f2')
    return told.tobytes() if told.any() else None


def unpacked_depths(stored: bytes, cells: int) -> Depths:
    """Return depths of regions, row by row; ValueError if they are not of so many cells."""
    side = cells - REGION.span + 1
    depths = np.frombuffer(stored, '<f2').astype(np.float64)
    if len(depths) != side**2:
        raise ValueError(f'{len(depths)} depths, but {side**2} regions')
    with np.errstate(invalid='ignore'):
        is_known = (depths >= SAMPLE.nearest_m) & (depths <= SAMPLE.furthest_m)
    return np.where(is_known, depths, np.nan)
