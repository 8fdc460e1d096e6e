# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Verification: how much of a displacement field one smooth motion of the image explains.

At the true place, neighbours move together, and the motion changes slowly across the image. At
another place, displacements scatter. There is no random sampling: the motion starts as the common
shift and is fitted repeatedly to the regions that agree with it. So the result is repeatable, and
no motion is selected because it fits by chance. Fields are computed by `kernels.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isqrt

from convseq_ros.core.compiled import address, kernels_of
from convseq_ros.core.encoding.regions import REGION, Regions
from convseq_ros.core.geometry.lens import Points
from convseq_ros.core.types import constants, Doubles, Floats, Shift
import cv2
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


# An affine motion (2, 3): rows and columns moved, in cells, as a function of (1, row, column),
# positions in sides of the image from its middle; and the error of each region, in cells, (n,).
Motion = tuple[Doubles, Doubles]


@constants
class MOTION_FIT:
    """The fit; tuned on 10 sets, by day and darkened (docs/GEOMETRY.md)."""

    sigma_cells: float = 2.0  # error at which a region counts half; 1 misses parallax
    rounds: int = 8  # of the fit; it then changes by less than a tenth of a cell
    stiffness: float = 1.0  # prior for no slope, in regions: few regions make no wild motion


def initial_motion(start: tuple[int, int]) -> Doubles:
    """Return the motion (2, 3) that is a common shift of rows and columns."""
    return np.array([[start[0], 0.0, 0.0], [start[1], 0.0, 0.0]])


@dataclass(frozen=True, eq=False, slots=True)
class Verification:
    """The geometric agreement of two images; equal to itself only."""

    inliers: int  # regions of the displacement field with an error of at most 2 cells
    # Verification score: the sum of similarities over the field, weighted down with the error. Of
    # 900 regions, unrelated images give 26 to 50, the same place 60 at night to 500 by day.
    strength: float
    upper: float  # the part of `strength` from the query's upper half
    moved: Doubles | None = None  # the `motion` (2, 3); None if there is none


NOTHING = Verification(0, 0.0, 0.0)


def verify(
    query: PackedRegions, references: Sequence[PackedRegions], shifts: Sequence[Shift]
) -> list[Verification]:
    """Return the verifications of a query with references of its size, given common shifts."""
    starts = [_start(shift) for shift in shifts]
    rows = kernels_of(__package__).verified(query, references, starts)
    judged, moved = rows[:, :3].tolist(), rows[:, 3:].reshape(-1, 2, 3)
    return [
        Verification(int(inliers), strength, upper, motion)
        for (inliers, strength, upper), motion in zip(judged, moved, strict=True)
    ]


def field(query: PackedRegions, reference: PackedRegions, shift: Shift) -> Doubles:
    """
    Return the displacement field of two images that `verify` uses, (n, 5).

    Columns: row and column of a region's middle in the query, then in the reference, as shares of
    the image's height and width; then 1 for an inlier, else 0.
    """
    kernels, start = kernels_of(__package__), _start(shift)
    regions = kernels.displacements(query, reference, start)
    off = kernels.fit_motion(regions, query.side, start)[1]
    middles = np.hstack((regions[:, :2], regions[:, :2] + regions[:, 2:4])) + REGION.span / 2
    cells = query.side + REGION.span - 1
    return np.column_stack((middles / cells, off <= MOTION_FIT.sigma_cells)).astype(np.float64)


def motion(query: PackedRegions, reference: PackedRegions, shift: Shift) -> Doubles:
    """
    Return the motion (2, 3) that `verify` fits to two images.

    Rows and columns moved, in cells, are its products with (1, row, column): the position in sides
    of the image, in regions, from its middle.
    """
    kernels, start = kernels_of(__package__), _start(shift)
    return kernels.fit_motion(kernels.displacements(query, reference, start), query.side, start)[0]


def overlap(moved: Doubles, side: int) -> float:
    """
    Return how much of two images' views is common: the intersection over the union, in [0, 1].

    `moved` is a `motion` (2, 3) of images whose `side` is in regions.
    """
    corners = np.array([(-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (0.5, -0.5)])
    there = corners + (moved[:, 0] + corners @ moved[:, 1:].T) / side
    one, other = corners.astype(np.float32), there.astype(np.float32)
    common, _ = cv2.intersectConvexConvex(one, other)
    return float(common / (1 + cv2.contourArea(other) - common))


def _start(shift: Shift) -> tuple[int, int]:
    return round(shift[0]), round(shift[1])
