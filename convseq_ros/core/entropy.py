# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Local entropy: which parts of an image carry information (paper III-B)."""

import cv2
import numpy as np
import numpy.typing as npt
from skimage.filters.rank import entropy as local_entropy
from skimage.morphology import disk

MAX_BITS = 8.0
_SIDE_PX = 100
_DISK = disk(5)


def entropy_map(gray: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """
    Return the local entropy of a square image, in bits, at every pixel.

    Parameters
    ----------
    gray : ndarray of uint8, shape (S, S)
        The image, already resized.

    Returns
    -------
    ndarray of float64, shape (S, S)
        Entropy over a disk of radius 5, in [0, 6.34] bits (81 pixels at most).

    Notes
    -----
    As the released script, not as the paper's text: entropy is computed on a 100 x 100 copy of the
    resized image and enlarged again.

    """
    small = cv2.resize(gray, (_SIDE_PX, _SIDE_PX), interpolation=cv2.INTER_LINEAR)
    bits = local_entropy(small, _DISK)
    return cv2.resize(bits, gray.shape[::-1], interpolation=cv2.INTER_LINEAR)


def image_entropy(bits: npt.NDArray[np.float64]) -> float:
    """Return the mean of an entropy map as a share of 8 bits, in [0, 1]."""
    return float(bits.mean()) / MAX_BITS
