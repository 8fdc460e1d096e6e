# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The displacement field of two images: where each region of the one lies in the other."""

from dataclasses import dataclass
from math import isqrt

from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.regions import REGION, Regions
import numpy as np
import numpy.typing as npt

# (n, 5): row and column of a region, rows and columns that it moved, similarity; in cells.
Displacements = npt.NDArray[np.float32]


@constants
class FIELD:
    """Of the search; chosen on 10 sets, by day and darkened (docs/GEOMETRY.md)."""

    # Reach and radius are constants of kernels.c, too.
    reach_cells: int = 4  # of the search about the common shift; 5 is no better for its time
    sigma_cells: float = 1.0  # of the Gaussian over neighbours; 1.3 is alike, 1.7 worse
    radius_cells: int = 3  # where the Gaussian ends, three sigmas from its middle
    tolerance_cells: float = 0.7  # by which what leads there and back may miss
    spread: int = 32  # columns; rows of regions are padded to a multiple, as in kernels.c


@dataclass(frozen=True, eq=False, slots=True)
class Arranged:
    """The regions of an image as kernels read them; equal to itself only."""

    room: npt.NDArray[np.float32]  # `rows`, between numbers that a kernel may read
    side: int  # regions in a row of the image

    @property
    def rows(self) -> npt.NDArray[np.float32]:
        """The regions, and zeros to their right, (side, 32, wide)."""
        return self.first[: self.side * REGION.numbers * _wide(self.side)].reshape(
            self.side, REGION.numbers, -1
        )

    @property
    def first(self) -> npt.NDArray[np.float32]:
        """All from the first number of the first region on."""
        return self.room[_border(self.side) :]

    @property
    def regions(self) -> Regions:
        """The regions, (side ** 2, 32)."""
        image = self.rows[:, :, : self.side]
        return image.transpose(0, 2, 1).reshape(self.side**2, -1)


def arranged(regions: Regions) -> Arranged:
    """Return the regions (side ** 2, 32) of a square image as kernels read them."""
    side = isqrt(len(regions))
    numbers = side * REGION.numbers * _wide(side) + 2 * _border(side)
    room = np.zeros(numbers + 16, np.float32)  # of which it begins with a cache line
    made = Arranged(room[-room.ctypes.data % 64 // 4 :], side)
    made.rows[:, :, :side] = regions.reshape(side, side, -1).transpose(0, 2, 1)
    return made


def _wide(side: int) -> int:
    return -(-side // FIELD.spread) * FIELD.spread


def _border(side: int) -> int:
    """Return how many numbers before and behind the regions a kernel may read."""
    return _wide(side) + FIELD.spread


def weights() -> npt.NDArray[np.float32]:
    """Return what a region's neighbours on either side, and itself, count for: 7 numbers."""
    cells = np.arange(-FIELD.radius_cells, FIELD.radius_cells + 1)
    window = np.exp(-(cells**2) / (2 * FIELD.sigma_cells**2))
    return np.asarray(window / window.sum(), np.float32)
