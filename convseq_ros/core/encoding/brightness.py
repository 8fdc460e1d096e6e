# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The brightness of an image on a coarse grid, by which like light is recognised."""

from convseq_ros.core.types import constants, Doubles, Gray
import cv2
import numpy as np


@constants
class GRID:
    """The grid; 8 x 4 tells day, evening and night apart."""

    rows: int = 8
    columns: int = 4
    darkest: float = 4.0  # levels; darker pixels count as this bright


def brightness(gray: Gray) -> Doubles:
    """Return the logarithms of brightness (32,) of an image (H, W), on a grid of 8 x 4."""
    size = GRID.columns, GRID.rows
    small = cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.float64)
    return np.log(small.clip(GRID.darkest)).ravel()
