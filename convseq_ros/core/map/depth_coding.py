# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a map stores depths: one for each region, from a depth image."""

from convseq_ros.core.encoding.regions import REGION
from convseq_ros.core.types import are_proportional, constants, Doubles, Floats
import numpy as np

Depths = Doubles  # (n,), one for each region, metres along the optical axis; NaN if unknown


@constants
class SAMPLE:
    """Sampling of depth images; chosen by experience, not tuned."""

    grid: int = 5  # rows and columns of pixels that are read in a region's middle cell
    fewest: int = 13  # of these 25 pixels that must have a valid depth
    nearest_m: float = 0.1  # smaller depths are invalid
    furthest_m: float = 1000.0  # larger depths are invalid


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
    if not are_proportional(depth_m.shape, shape):
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
