# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Verification: how much of a displacement field one smooth motion of the image explains.

At the true place neighbours move alike, and slowly otherwise from left to right and from near to
far; elsewhere what is found there and back by chance scatters. No sample is drawn: the motion
starts as the common shift and is fitted again and again to what agrees with it, so that the answer
is repeatable, and chance finds no motion that explains it best.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.encoding.regions import REGION
from convseq_ros.core.geometry.displacement import Arranged
from convseq_ros.core.types import constants, Doubles, Shift
import numpy as np

# (2, 3): rows and columns moved, in cells, by 1, row and column, these counted in sides of the
# image from its middle; and how far each region is off it, in cells, (n,).
Motion = tuple[Doubles, Doubles]


@constants
class MOTION:
    """Of the fit; chosen on 10 sets, by day and darkened (docs/GEOMETRY.md)."""

    sigma_cells: float = 2.0  # off the motion, at which a region counts half; 1 misses parallax
    rounds: int = 8  # of the fit; by then it moves by less than a tenth of a cell
    stiffness: float = 1.0  # regions that speak for no slope: few regions make no wild motion


def initial_motion(start: tuple[int, int]) -> Doubles:
    """Return the motion (2, 3) that is a common shift of rows and columns."""
    return np.array([[start[0], 0.0, 0.0], [start[1], 0.0, 0.0]])


@dataclass(frozen=True, slots=True)
class Verification:
    """What the geometry of two images says."""

    inliers: int  # regions found there and back that are at most 2 cells off the motion
    # The similarities of regions found there and back, those off the motion counted for less. Of
    # 900 regions, unrelated images give 26 to 50, the same place 60 at night to 500 by day.
    strength: float
    upper: float  # what regions of the query's upper half add to it


NOTHING = Verification(0, 0.0, 0.0)


def verify(
    query: Arranged, references: Sequence[Arranged], shifts: Sequence[Shift]
) -> list[Verification]:
    """Return what geometry says of a query and references of its size, by their common shifts."""
    starts = [_start(shift) for shift in shifts]
    judged = kernels_of(__package__).verified(query, references, starts).tolist()
    return [Verification(int(inliers), *strengths) for inliers, *strengths in judged]


def field(query: Arranged, reference: Arranged, shift: Shift) -> Doubles:
    """
    Return the displacement field of two images that `verify` judges, (n, 5).

    Row and column of a region's middle in the query and in the reference, as shares of the image's
    height and width, and 1 for an inlier, else 0.
    """
    kernels, start = kernels_of(__package__), _start(shift)
    found = kernels.displacements(query, reference, start)
    off = kernels.fit_motion(found, query.side, start)[1]
    middles = np.hstack((found[:, :2], found[:, :2] + found[:, 2:4])) + REGION.span / 2
    cells = query.side + REGION.span - 1
    return np.column_stack((middles / cells, off <= MOTION.sigma_cells)).astype(np.float64)


def _start(shift: Shift) -> tuple[int, int]:
    return round(shift[0]), round(shift[1])
