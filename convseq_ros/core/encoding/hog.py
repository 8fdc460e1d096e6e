# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Histograms of oriented gradients, one for every cell of an image (paper III-C)."""

from convseq_ros.core.compiled import available
import cv2
import numpy as np
import numpy.typing as npt

CELL_PX = 16
BINS = 8
_BIN_DEG = 360.0 / BINS
_MARGIN_PX = 2
# Few enough rows at a time for what is computed of them to stay in the processor's cache.
_STRIP_CELLS = 4

Pixels = npt.NDArray[np.float32]


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
    their own cell only. Equal pixels leave a gradient of some 1e-12 in (2), float64's rounding; it
    is kept, for a region of such cells only is scaled to unit length like any other.

    """
    side = gray.shape[0] // CELL_PX
    cells = np.zeros((side, side, BINS), np.float32)
    brightest = float(gray.max())
    if brightest == 0.0:
        return cells
    gamma = np.sqrt(np.arange(256) / brightest) * 255.0
    framed = cv2.copyMakeBorder(gray, *(_MARGIN_PX,) * 4, borderType=cv2.BORDER_REFLECT_101)
    for first in range(0, side, _STRIP_CELLS):
        strip = cells[first : first + _STRIP_CELLS]
        start = first * CELL_PX
        rows = framed[start : start + len(strip) * CELL_PX + 2 * _MARGIN_PX]
        gx, gy = _gradients(cv2.LUT(rows, gamma))
        bins = cv2.phase(gx, gy, angleInDegrees=True)
        bins *= np.float32(1 / _BIN_DEG)
        strength = cv2.absdiff(gx, -gy)
        strength *= np.float32(0.5)
        votes = _column_votes(strength, bins, len(strip))
        votes[:, 0] += votes[:, BINS]
        of_cells = votes[:, :BINS].reshape(len(strip), BINS, side, CELL_PX).sum(axis=3)
        strip[:] = of_cells.transpose(0, 2, 1)
    return cells


def _gradients(framed: npt.NDArray[np.float64]) -> tuple[Pixels, Pixels]:
    """Return the Sobel gradients of an image, without its margin, along x and y."""
    if available():
        from convseq_ros.core.encoding.kernels import gradients

        height, width = (length - 2 * _MARGIN_PX for length in framed.shape)
        gx, gy = np.empty((2, height, width), np.float32)
        gradients(framed, gx, gy)
        return gx, gy
    inner = slice(_MARGIN_PX, -_MARGIN_PX)
    gx, gy = (
        cv2.Sobel(framed, cv2.CV_64F, *order, ksize=5)[inner, inner].astype(np.float32)
        for order in ((1, 0), (0, 1))
    )
    return gx, gy


def _column_votes(strength: Pixels, bins: Pixels, rows: int) -> npt.NDArray[np.float32]:
    """Return the votes of each column for bins 0 to 8 in each row of cells, (rows, 9, S)."""
    votes = np.empty((rows, BINS + 1, strength.shape[1]), np.float32)
    if available():
        from convseq_ros.core.encoding.kernels import column_votes

        column_votes(strength, bins, votes)
        return votes
    share = np.empty_like(bins)
    for middle in range(BINS + 1):
        np.subtract(bins, np.float32(middle), out=share)
        np.abs(share, out=share)
        np.subtract(np.float32(1), share, out=share)
        np.maximum(share, 0, out=share)
        share *= strength
        np.add.reduce(share.reshape(rows, CELL_PX, -1), axis=1, out=votes[:, middle])
    return votes
