# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The functions of `kernels` by NumPy and OpenCV: the definition, and the fallback without C."""

from convseq_ros.core.encoding.regions import projected_regions as project
from convseq_ros.core.types import Doubles, Floats, Gray, Indices
import cv2
import numpy as np
import numpy.typing as npt

__all__ = ['disk_sums', 'histograms', 'project']

_INSIDE = slice(2, -2)  # of what is framed; a 5 x 5 Sobel filter reaches two pixels further


def disk_sums(
    levels: npt.NDArray[np.uint16], half_widths: Indices, terms: Doubles, sums: Doubles
) -> None:
    """Fill in the sum of `terms` by each level's count in a disk around every pixel."""
    radius, (_, width), kinds = half_widths.size // 2, sums.shape, int(levels.max()) + 1
    disk = abs(np.arange(-radius, radius + 1)) <= half_widths[:, None]
    around = np.lib.stride_tricks.sliding_window_view(levels, disk.shape)
    first = kinds * np.arange(width)[:, None]  # of the counts of each pixel in a row
    for row, disks in zip(sums, around, strict=True):
        counts = np.bincount((disks[:, disk] + first).ravel(), minlength=width * kinds)
        row[:] = terms[counts].reshape(width, kinds).sum(axis=1)


def histograms(framed: Gray, gamma: Doubles, cells: Floats) -> None:
    """Fill in the cells (S, S, 8) of an image (16 S + 4, 16 S + 4); `gamma` is by grey level."""
    side, _, bins = cells.shape
    bright = cv2.LUT(framed, gamma)
    gx, gy = (
        cv2.Sobel(bright, cv2.CV_64F, *order, ksize=5)[_INSIDE, _INSIDE].astype(np.float32)
        for order in ((1, 0), (0, 1))
    )
    position = cv2.phase(gx, gy, angleInDegrees=True) * np.float32(bins / 360.0)
    strength = abs(gx + gy) * np.float32(0.5)
    in_cells = side, len(gx) // side, side, len(gx) // side
    cells[:] = 0
    for middle in range(bins + 1):  # the last one is the first again
        share = np.maximum(1 - abs(position - np.float32(middle)), 0)
        cells[:, :, middle % bins] += (share * strength).reshape(in_cells).sum(axis=(1, 3))
