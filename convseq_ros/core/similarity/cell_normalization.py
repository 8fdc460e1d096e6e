# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells in which noise and the strength of edges count for less."""

import cv2
import numpy as np
import numpy.typing as npt

# A Gaussian of 0.4 cells.
SIDE = 0.0404
MIDDLE = 1 - 2 * SIDE
SATURATION = 6.0

Cells = npt.NDArray[np.float32]


def evened(cells: Cells) -> Cells:
    """
    Return cells less their noise, with strong edges made more like weak ones.

    Noise has no direction, so what is in all bins of a cell alike is taken off: the smallest of
    them. Then neighbouring cells are blended a little, so that an edge may lie on either side of
    their border, and each number x becomes x / (x + 6 m), m the mean of the image: else a lamp or
    one tree's edge would be all that a region shows.

    Parameters
    ----------
    cells : ndarray of float32, shape (S, S, 8)
        Cell histograms.

    Returns
    -------
    ndarray of float32, shape (S, S, 8)
        In [0, 1).

    """
    above = cells - cells.min(axis=2, keepdims=True)
    kernel = np.array([SIDE, MIDDLE, SIDE], np.float32)
    blended = cv2.sepFilter2D(above, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
    usual = np.float32(SATURATION * blended.mean(dtype=np.float64))
    return blended / (blended + usual) if usual else blended
