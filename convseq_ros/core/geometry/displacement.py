# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The displacement field of two images: where each region of the first lies in the second."""

from dataclasses import dataclass
from math import isqrt

from convseq_ros.core.compiled import address, kernels_of
from convseq_ros.core.encoding.regions import REGION, Regions
from convseq_ros.core.geometry.lens import Points
from convseq_ros.core.types import constants, Floats
import numpy as np
import numpy.typing as npt

# (n, 5): row and column of a region, rows and columns that it moved, in cells; its similarity.
Displacements = Floats
_WORDS = REGION.numbers // 4  # words of four bytes per region
_SPREAD = 32  # rows are padded to a multiple of 32 columns, as in kernels.c


@constants
class FIELD:
    """The search; tuned on 10 sets, by day and darkened (docs/GEOMETRY.md)."""

    # Reach and radius are constants of kernels.c, too.
    reach_cells: int = 4  # of the search around the common shift; 5 is not worth its time
    sigma_cells: float = 1.0  # of the Gaussian over neighbours; 1.3 is no better, 1.7 worse
    radius_cells = round(3 * sigma_cells)  # where the Gaussian ends
    tolerance_cells: float = 0.7  # largest error of a displacement there and back
    # With this scale, sums of products of two regions stay below 2 ** 15, in any order.
    scale = REGION.byte_scale


@dataclass(frozen=True, eq=False, slots=True)
class PackedRegions:
    """The regions of an image as bytes in the layout of the kernels; equal to itself only."""

    # (side, 8, wide), aligned to a cache line: each word holds four bytes of a region; rows are
    # padded with zeros on the right.
    # Before and after the array lie 32 + `wide` words that a kernel may read.
    rows: npt.NDArray[np.int32]

    @property
    def side(self) -> int:
        """Number of regions in a row of the image."""
        return len(self.rows)

    @property
    def regions(self) -> Regions:
        """The regions, (side ** 2, 32), rounded to their bytes."""
        words = np.ascontiguousarray(self.rows[:, :, : self.side].transpose(0, 2, 1))
        return words.view(np.int8).reshape(self.side**2, -1) * np.float32(1 / FIELD.scale)


def packed_regions(regions: Regions) -> PackedRegions:
    """Return regions (side ** 2, 32), of at most unit length, for the kernels; NaN becomes 0."""
    side = isqrt(len(regions))
    wide = -(-side // _SPREAD) * _SPREAD
    count, border = side * _WORDS * wide, wide + _SPREAD
    room = np.zeros(count + 2 * border + 16, np.int32)
    first = border + -address(room) % 64 // 4
    rows = room[first : first + count].reshape(side, _WORDS, wide)
    kernels_of(__package__).arrange(regions, rows)
    return PackedRegions(rows)


def weights() -> Floats:
    """Return the weights (7,) of a region and its neighbours in a row or column; sum 1."""
    cells = np.arange(-FIELD.radius_cells, FIELD.radius_cells + 1)
    window = np.exp(-(cells**2) / (2 * FIELD.sigma_cells**2))
    return np.asarray(window / window.sum(), np.float32)


def found_in(regions: PackedRegions, other: PackedRegions, start: tuple[int, int]) -> Points:
    """
    Return where regions lie in another image, rows and columns (n, 2); NaN if not found.

    The search is around `start`, a common shift of rows and columns.
    """
    field = kernels_of(__package__).displacements(regions, other, start).astype(np.float64)
    places = np.full((regions.side**2, 2), np.nan)
    places[(field[:, 0] * regions.side + field[:, 1]).astype(int)] = field[:, :2] + field[:, 2:4]
    return places
