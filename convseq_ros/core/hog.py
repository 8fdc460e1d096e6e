# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Histograms of oriented gradients, one for every cell of an image (paper III-C)."""

import cv2
import numpy as np
import numpy.typing as npt

CELL_PX = 16
BINS = 8
_BIN_DEG = 360.0 / BINS


def cell_histograms(gray: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """
    Return the orientation histogram of every 16 x 16 px cell.

    Parameters
    ----------
    gray : ndarray of uint8, shape (S, S)
        The image; S is a multiple of 16.

    Returns
    -------
    ndarray of float32, shape (S / 16, S / 16, 8)
        Sums of gradient strength, not normalised; all zero for an image without gradient.

    Notes
    -----
    As the released script, with the following choices where the paper is silent: (1) the image is
    gamma-corrected by the square root of its share of the brightest pixel; (2) gradients are 5 x 5
    Sobel; (3) strength is abs(gx + gy) / 2, not the Euclidean length; (4) orientation is signed,
    over 360 degrees, and each pixel votes for its two nearest bins linearly; (5) pixels vote in
    their own cell only.

    """
    side = gray.shape[0] // CELL_PX
    brightest = float(gray.max())
    if brightest == 0.0:
        return np.zeros((side, side, BINS), np.float32)
    corrected = np.sqrt(gray / brightest) * 255.0
    gx = cv2.Sobel(corrected, cv2.CV_64F, 1, 0, ksize=5)
    gy = cv2.Sobel(corrected, cv2.CV_64F, 0, 1, ksize=5)
    strength = np.abs(gx + gy) / 2
    position = cv2.phase(gx, gy, angleInDegrees=True) / _BIN_DEG
    lower = np.floor(position).astype(np.int64)
    upper_share = position - lower
    cell = np.arange(gray.shape[0]) // CELL_PX
    first_bin = (cell[:, None] * side + cell) * BINS
    votes = np.zeros(side * side * BINS)
    for bins, share in ((lower, 1 - upper_share), (lower + 1, upper_share)):
        index = first_bin + bins % BINS
        votes += np.bincount(index.ravel(), (strength * share).ravel(), votes.size)
    return votes.reshape(side, side, BINS).astype(np.float32)
