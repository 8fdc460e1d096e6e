# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The motion of an image: how far its regions move, as one affine function of where they lie."""

from convseq_ros.core.constants import constants
import numpy as np
import numpy.typing as npt

# (2, 3): rows and columns moved, in cells, by 1, row and column, these counted in sides of the
# image from its middle; and how far each region is off it, in cells, (n,).
Motion = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]


@constants
class MOTION:
    """Of the fit; chosen on 10 sets, by day and darkened (docs/GEOMETRY.md)."""

    sigma_cells: float = 2.0  # off the motion, at which a region counts half; 1 misses parallax
    rounds: int = 8  # of the fit; by then it moves by less than a tenth of a cell
    stiffness: float = 1.0  # regions that speak for no slope: few regions make no wild motion


def initial_motion(start: tuple[int, int]) -> npt.NDArray[np.float64]:
    """Return the motion (2, 3) that is a common shift of rows and columns."""
    return np.array([[start[0], 0.0, 0.0], [start[1], 0.0, 0.0]])
