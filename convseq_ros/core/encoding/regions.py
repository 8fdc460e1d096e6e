# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Regions: overlapping blocks of cells as unit vectors, by which images are compared.

The paper's regions have 2 x 2 cells. Ours have 3 x 3 cells, projected from 72 to 32 numbers. The
global descriptor summarises the image's projected regions in half a kilobyte.
"""

from functools import cache
from importlib.resources import files
from math import isqrt

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.types import constants, Doubles, Floats, Halves
import numpy as np
import numpy.typing as npt

Cells = Floats
Regions = Floats


@constants
class REGION:
    """Sizes; engineering, those of the global descriptor by recall (commit ad68631c)."""

    span: int = 3  # cells in a row of a projected region
    numbers: int = 32  # of a projected region, as of a region of the paper (projection.md)
    byte_scale: float = 160.0  # from numbers to bytes; hardly any of a unit vector is clipped
    frequencies: int = 6  # of a global descriptor: row plus column index is below 6; 21 pairs
    axes: int = 12  # of a global descriptor; the first of the 32 numbers of regions


def unit(rows: npt.NDArray[np.floating]) -> Floats:
    """Return vectors, along the last axis, at unit length; zero ones stay zero."""
    length = np.sqrt(np.einsum('...i,...i->...', rows, rows))[..., None]
    return rows / np.where(length > 0, length, length.dtype.type(1))


def regions_in_a_row(size: int, step: int = 1, span: int = REGION.span) -> int:
    """Return how many regions of `span` cells, `step` cells apart, a row of cells has."""
    return (size - span) // step + 1


def joined_regions(cells: Cells, span: int = REGION.span, step: int = 1) -> Regions:
    """Return n x n-cell regions of cells (S, S, 8), every `step`-th, as unit rows (N, 8 n^2)."""
    cells = np.ascontiguousarray(cells)
    (height, width, bins), (row, column, number) = cells.shape, cells.strides
    # In memory, neighbouring cells of a row are contiguous.
    down, right = (regions_in_a_row(size, step, span) for size in (height, width))
    shape = down, right, span, span * bins
    strides = step * row, step * column, row, number
    joined = np.lib.stride_tricks.as_strided(cells, shape, strides, writeable=False)
    return unit(joined.reshape(-1, span * span * bins))


@cache
def projection() -> tuple[Floats, Floats]:
    """Return the fixed mean (72,) and projection (72, 32); projection.md gives their origin."""
    with files(__package__).joinpath('projection.npy').open('rb') as file:
        stored = np.load(file, allow_pickle=False)
    return stored[:, 0], stored[:, 1:]


def projected_regions(cells: Cells, step: int = 1) -> Regions:
    """Return the projected 3 x 3-cell regions of cells, every `step`-th, as unit rows (N, 32)."""
    mean, axes = projection()
    return unit((joined_regions(cells, step=step) - mean) @ axes)


def global_descriptor(cells: Cells) -> Halves:
    """
    Return the global descriptor of cells (S, S, 8): (252,), fewer below 128 px; not normalised.

    It is a cosine transform of the first 12 numbers of projected regions (the leading axes), with
    the 21 lowest frequencies: these change little with a shift of a few cells, and axes of little
    variance are mostly noise at night. It is fixed, so that maps can grow. Sums are float64, so
    that after rounding they do not depend on the processor's order of addition.
    """
    regions = kernels_of(__package__).project(cells)
    side = isqrt(len(regions))
    waves = _waves(side)
    rows = waves @ regions[:, : REGION.axes].reshape(side, -1).astype(np.float64)
    spectrum = waves @ rows.reshape(len(waves), side, REGION.axes)
    low = np.add.outer(range(len(waves)), range(len(waves))) < REGION.frequencies
    return spectrum[low].ravel().astype(np.float16)


@cache
def global_descriptor_length(cell_shape: tuple[int, int, int]) -> int:
    """Return the length of the global descriptor for cells of a shape."""
    return len(global_descriptor(np.zeros(cell_shape, np.float32)))


@cache
def _waves(side: int) -> Doubles:
    """Return the rows of a cosine transform, (frequencies, side), scaled to give means."""
    frequency = np.arange(min(REGION.frequencies, side))[:, None]
    phase = np.pi * frequency * (np.arange(side) + 0.5) / side
    return np.asarray(np.where(frequency, np.sqrt(2.0), 1.0) / side * np.cos(phase))


def thinned(regions: Regions, step: int) -> Regions:
    """Return every `step`-th row and column of a square of regions (N, 32)."""
    side = isqrt(len(regions))
    kept = regions.reshape(side, side, -1)[::step, ::step]
    return kept.reshape(-1, regions.shape[1])
