# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Normalised cells: noise and the strength of edges count for less."""

from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.regions import Cells
import cv2
import numpy as np


@constants
class NORMALIZATION:
    """Chosen among 50 variants on real and darkened image pairs (docs/MATCHING.md)."""

    side: float = 0.0404  # share of a neighbour; a Gaussian of 0.4 cells
    middle: float = 1 - 2 * 0.0404  # share of the cell itself
    saturation: float = 6.0  # means of the image at which a number counts half


def normalized(cells: Cells) -> Cells:
    """
    Return cells (S, S, 8) less their noise, with strong edges made more like weak ones, in [0, 1).

    Noise has no direction: what is in all bins of a cell alike, the smallest of them, is taken
    off. Neighbouring cells are blended a little, so that an edge may lie on either side of their
    border. Each number x becomes x / (x + 6 m), with m the mean of the image: else a lamp or one
    tree's edge is all that a region shows.
    """
    above = cells - cells.min(axis=2, keepdims=True)
    kernel = np.array([NORMALIZATION.side, NORMALIZATION.middle, NORMALIZATION.side], np.float32)
    blended = cv2.sepFilter2D(above, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
    typical = np.float32(NORMALIZATION.saturation * blended.mean(dtype=np.float64))
    return blended / (blended + typical) if typical else blended
