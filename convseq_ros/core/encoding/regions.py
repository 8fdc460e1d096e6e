# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Regions: overlapping blocks of cells as unit vectors, which are what is compared of two images.

The paper's are of 2 x 2 cells (III-C); those of coherent matching, ours, are of 3 x 3 cells and
projected from 72 to 32 numbers.
"""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
import numpy.typing as npt

Cells = npt.NDArray[np.float32]
Regions = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class RegionConstants:
    """Size of the projected regions; chosen on real image pairs (docs/MATCHING.md)."""

    span: int = 3  # cells in a row of a region
    numbers: int = 32  # of a projected region; projection.md says what is lost


REGION = RegionConstants()


def unit(rows: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Return vectors, along the last axis, at unit length; zero ones stay zero."""
    length = np.sqrt(np.einsum('...i,...i->...', rows, rows))[..., None]
    return rows / np.where(length > 0, length, length.dtype.type(1))


def paper_regions(cells: Cells) -> Regions:
    """
    Return the 2 x 2-cell regions of cells (S, S, bins), row by row: ((S - 1) ** 2, 4 * bins).

    Unit length, or 0 for a region without gradient (paper III-C).
    """
    joined = np.concatenate(
        (cells[:-1, :-1], cells[:-1, 1:], cells[1:, :-1], cells[1:, 1:]), axis=2
    )
    return unit(joined.reshape(-1, 4 * cells.shape[2]))


@cache
def projection() -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return the fixed mean (72,) and projection (72, 32); projection.md says where from."""
    with files(__package__).joinpath('projection.npy').open('rb') as file:
        stored = np.load(file, allow_pickle=False)
    return stored[:, 0], stored[:, 1:]


def joined_regions(cells: Cells) -> Regions:
    """Return the 3 x 3-cell regions of cells (S, S, 8) as unit rows: ((S - 2) ** 2, 72)."""
    side, bins = cells.shape[0] - REGION.span + 1, cells.shape[2]
    cells = np.ascontiguousarray(cells)
    rows, columns, one = cells.strides
    # In memory, the cells of a region that lie side by side are one run of numbers.
    joined = np.lib.stride_tricks.as_strided(
        cells,
        (side, side, REGION.span, REGION.span * bins),
        (rows, columns, rows, one),
        writeable=False,
    )
    return unit(joined.reshape(side * side, -1))


def projected_regions(cells: Cells) -> Regions:
    """
    Return the projected 3 x 3-cell regions of cells (S, S, 8), row by row: ((S - 2) ** 2, 32).

    Unit length.
    """
    mean, axes = projection()
    return unit((joined_regions(cells) - mean) @ axes)
