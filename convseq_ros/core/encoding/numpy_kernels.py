# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `kernels` computes, by NumPy and OpenCV: the oracle, and the fallback without C."""

from convseq_ros.core.encoding.regions import projected_regions as project
import cv2
import numpy as np
import numpy.typing as npt

__all__ = ['disk_sums', 'histograms', 'project']
_INSIDE = slice(2, -2)  # of what is framed; a 5 x 5 Sobel reaches two pixels beyond


def disk_sums(
    levels: npt.NDArray[np.uint16],
    half_widths: npt.NDArray[np.int64],
    terms: npt.NDArray[np.float64],
    sums: npt.NDArray[np.float64],
) -> None:
    """Fill in the sum of c log2 c over a disk around every pixel, one level after the other."""
    radius = half_widths.size // 2
    disk = abs(np.arange(-radius, radius + 1)) <= half_widths[:, None]
    inside = slice(radius, -radius)
    sums[:] = 0
    for level in np.unique(levels):
        counts = cv2.filter2D((levels == level).view(np.uint8), -1, disk.view(np.uint8))
        sums += terms[counts[inside, inside]]


def histograms(
    framed: npt.NDArray[np.uint8], gamma: npt.NDArray[np.float64], cells: npt.NDArray[np.float32]
) -> None:
    """Fill in the cells (S, S, 8) of an image (16 S + 4, 16 S + 4), given each level's gamma."""
    side, _, bins = cells.shape
    bright = cv2.LUT(framed, gamma)
    gx, gy = (
        cv2.Sobel(bright, cv2.CV_64F, *order, ksize=5)[_INSIDE, _INSIDE].astype(np.float32)
        for order in ((1, 0), (0, 1))
    )
    orientation = cv2.phase(gx, gy, angleInDegrees=True) * np.float32(bins / 360.0)
    strength = cv2.absdiff(gx, -gy) * np.float32(0.5)
    in_cells = side, len(gx) // side, side, len(gx) // side
    for middle in range(bins + 1):
        share = np.maximum(1 - abs(orientation - np.float32(middle)), 0)
        rows = (share * strength).reshape(in_cells).sum(axis=1)
        cells[:, :, middle % bins] += rows.sum(axis=2)
