# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The functions of `kernels` by NumPy and OpenCV: the definition, and the fallback without C."""

from convseq_ros.core.encoding.regions import projected_regions as project
from convseq_ros.core.types import Doubles, Floats, Gray, Indices
import cv2
import numpy as np
import numpy.typing as npt

__all__ = ['disk_sums', 'histograms', 'project']

_MARGIN_PX = 2  # on each side of the image, for a 5 x 5 Sobel filter
_INSIDE = slice(_MARGIN_PX, -_MARGIN_PX)
_STRIP_CELLS = 4  # rows of cells at once; measured: they stay in the processor's cache


def disk_sums(
    levels: npt.NDArray[np.uint16], half_widths: Indices, terms: Doubles, sums: Doubles
) -> None:
    """
    Fill in the sum of c log2 c over a disk around every pixel, without loops over pixels.

    In reading order, the n-th pixel of a level adds n log2 n - (n - 1) log2 (n - 1). So equal
    pixels before each pixel of the disk are counted, for all disks at once, by running sums along
    the rows of the image.
    """
    height, width = sums.shape
    line, size = levels.shape[1], levels.size
    reach = half_widths.size - 1
    radius = reach // 2
    slack = np.full(reach * line + reach, levels[0, 0], np.uint16)
    flat = np.concatenate([slack, levels.ravel(), slack[:reach]])
    here = flat[slack.size : slack.size + size]
    middle = half_widths.cumsum() * 2 - half_widths + np.arange(half_widths.size)
    rank = np.ones((terms.size - 1, height * line), np.uint8)
    equal = np.zeros((2 * reach + 2, size + reach), np.uint8)
    for up in range(reach + 1):
        shifts = range(-reach, reach + 1 if up else 0)
        for index, shift in enumerate(shifts):
            start = slack.size - up * line + shift
            same = (flat[start : start + size] == here).view(np.uint8)
            np.add(equal[index, :size], same, out=equal[index + 1, :size])
        for row in range(up, half_widths.size):
            half = half_widths[row - up]
            for x in range(-half_widths[row], half_widths[row] + 1):
                start = row * line + radius + x
                counted = equal[:, start : start + height * line]
                first, end = -half - x, half - x + 1 if up else 0
                of_pixel = rank[middle[row] + x]
                of_pixel += counted[reach + end]
                of_pixel -= counted[reach + first]
    added = np.zeros(256)
    added[1 : terms.size] = np.diff(terms)
    sums[:] = 0
    for of_pixel in rank.reshape(-1, height, line):
        sums += cv2.LUT(of_pixel, added)[:, :width]


def histograms(framed: Gray, gamma: Doubles, cells: Floats) -> None:
    """Fill in the cells (S, S, 8) of an image (16 S + 4, 16 S + 4); `gamma` is by grey level."""
    side, _, bins = cells.shape
    width = len(framed) - 2 * _MARGIN_PX
    cell_px = width // side
    for first in range(0, side, _STRIP_CELLS):
        strip = cells[first : first + _STRIP_CELLS]
        start, height = first * cell_px, len(strip) * cell_px
        rows = cv2.LUT(framed[start : start + height + 2 * _MARGIN_PX], gamma)
        gx, gy = (
            cv2.Sobel(rows, cv2.CV_64F, *order, ksize=5)[_INSIDE, _INSIDE].astype(np.float32)
            for order in ((1, 0), (0, 1))
        )
        orientation = cv2.phase(gx, gy, angleInDegrees=True)
        orientation *= np.float32(bins / 360.0)
        strength = cv2.absdiff(gx, -gy)
        strength *= np.float32(0.5)
        votes = np.empty((len(strip), bins + 1, width), np.float32)
        share = np.empty_like(orientation)
        for middle in range(bins + 1):
            np.subtract(orientation, np.float32(middle), out=share)
            np.abs(share, out=share)
            np.subtract(np.float32(1), share, out=share)
            np.maximum(share, 0, out=share)
            share *= strength
            np.add.reduce(share.reshape(len(strip), cell_px, -1), axis=1, out=votes[:, middle])
        votes[:, 0] += votes[:, bins]
        of_cells = votes[:, :bins].reshape(len(strip), bins, side, cell_px).sum(axis=3)
        strip[:] = of_cells.transpose(0, 2, 1)
