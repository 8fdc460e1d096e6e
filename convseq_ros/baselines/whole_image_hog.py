# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Histograms of oriented gradients of the whole image as one descriptor (Dalal, Triggs 2005)."""

import cv2
import numpy as np
import numpy.typing as npt

_SIDE_PX = 512
_CELL_PX = 16
_BINS = 9
_BLOCK_CELLS = 2


def whole_image_hog(gray: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Return scikit-image's HOG (34596,) of a grey image resized to 512 x 512, as in VPR-Bench."""
    from skimage.feature import hog

    resized = cv2.resize(gray, (_SIDE_PX, _SIDE_PX), interpolation=cv2.INTER_LINEAR)
    return hog(
        resized,
        orientations=_BINS,
        pixels_per_cell=(_CELL_PX, _CELL_PX),
        cells_per_block=(_BLOCK_CELLS, _BLOCK_CELLS),
    ).astype(np.float32)
