# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The displacement field of two images: where each region of the one lies in the other."""

from dataclasses import dataclass
from math import isqrt

from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.regions import Regions
import numpy as np
import numpy.typing as npt

# (n, 5): row and column of a region, rows and columns that it moved, similarity; in cells.
Displacements = npt.NDArray[np.float32]


@constants
class FIELD:
    """Of the search; chosen on 10 sets, by day and darkened (docs/GEOMETRY.md)."""

    reach_cells: int = 4  # of the search about the common shift; 5 is no better for its time
    sigma_cells: float = 1.0  # of the Gaussian over neighbours; 1.3 is alike, 1.7 worse
    radius_cells: int = 3  # where the Gaussian ends, three sigmas from its middle
    tolerance_cells: float = 0.7  # by which what leads there and back may miss
    padding: int = 32  # numbers behind the regions, that a kernel may read


@dataclass(frozen=True, eq=False, slots=True)
class Arranged:
    """The regions of an image as kernels read them; equal to itself only."""

    numbers: npt.NDArray[np.float32]  # (side, 32, side), and `padding` more, in one vector
    side: int  # regions in a row of the image

    @property
    def regions(self) -> Regions:
        """The regions, (side ** 2, 32)."""
        image = self.numbers[: -FIELD.padding].reshape(self.side, -1, self.side)
        return image.transpose(0, 2, 1).reshape(self.side**2, -1)


def arranged(regions: Regions) -> Arranged:
    """Return the regions (side ** 2, 32) of a square image as kernels read them."""
    side = isqrt(len(regions))
    numbers = np.zeros(regions.size + FIELD.padding, np.float32)
    rows = numbers[: regions.size].reshape(side, -1, side)
    rows[:] = regions.reshape(side, side, -1).transpose(0, 2, 1)
    return Arranged(numbers, side)


def weights() -> npt.NDArray[np.float32]:
    """Return what a region's neighbours on either side, and itself, count for: 7 numbers."""
    cells = np.arange(-FIELD.radius_cells, FIELD.radius_cells + 1)
    window = np.exp(-(cells**2) / (2 * FIELD.sigma_cells**2))
    return np.asarray(window / window.sum(), np.float32)
