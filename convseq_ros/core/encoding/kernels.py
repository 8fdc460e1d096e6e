# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The inner loops of an image's encoding, for numba to compile.

Each does the operations of its counterpart in NumPy or OpenCV in their order, so that results
differ in the last bit at most. To be imported only where functions are compiled.
"""

from convseq_ros.core.compiled import compiled
import numpy as np
import numpy.typing as npt


@compiled
def disk_sums(
    levels: npt.NDArray[np.uint16],
    half_widths: npt.NDArray[np.int64],
    terms: npt.NDArray[np.float64],
    sums: npt.NDArray[np.float64],
) -> None:
    """
    Fill in the sum of a function of each level's count, over a disk around every pixel.

    The disk slides along a row: where pixels enter and leave it, counts and sum are corrected.

    Parameters
    ----------
    levels : ndarray of uint16, shape (H + D - 1, W + D - 1)
        The image with a margin as wide as the disk's radius.
    half_widths : ndarray of int64, shape (D,)
        Pixels of the disk right of its middle, row by row.
    terms : ndarray of float64
        The function, at every count from 0; sums of its values must be exact.
    sums : ndarray of float64, shape (H, W)
        The result.

    """
    diameter = half_widths.size
    radius = diameter // 2
    counts = np.empty(int(levels.max()) + 1, np.int64)
    for y in range(sums.shape[0]):
        counts[:] = 0
        total = 0.0
        for row in range(diameter):
            for x in range(radius - half_widths[row], radius + half_widths[row] + 1):
                level = levels[y + row, x]
                total += terms[counts[level] + 1] - terms[counts[level]]
                counts[level] += 1
        sums[y, 0] = total
        for x in range(1, sums.shape[1]):
            for row in range(diameter):
                left = levels[y + row, x - 1 + radius - half_widths[row]]
                entered = levels[y + row, x + radius + half_widths[row]]
                total += terms[counts[left] - 1] - terms[counts[left]]
                counts[left] -= 1
                total += terms[counts[entered] + 1] - terms[counts[entered]]
                counts[entered] += 1
            sums[y, x] = total


@compiled
def gradients(
    framed: npt.NDArray[np.float64], gx: npt.NDArray[np.float32], gy: npt.NDArray[np.float32]
) -> None:
    """
    Fill in the 5 x 5 Sobel gradients of an image.

    Parameters
    ----------
    framed : ndarray of float64, shape (H + 4, W + 4)
        The image with a margin of two pixels.
    gx, gy : ndarray of float32, shape (H, W)
        The result.

    """
    slopes = np.empty((5, gx.shape[1]))
    means = np.empty((5, gx.shape[1]))
    for y in range(framed.shape[0]):
        _across(framed[y], slopes[y % 5], means[y % 5])
        if y >= 4:
            a, b, c, d, e = (y + 1) % 5, (y + 2) % 5, (y + 3) % 5, (y + 4) % 5, y % 5
            _weighed(slopes[a], slopes[b], slopes[c], slopes[d], slopes[e], gx[y - 4])
            _slope(means[a], means[b], means[d], means[e], gy[y - 4])


@compiled
def _across(
    line: npt.NDArray[np.float64], slopes: npt.NDArray[np.float64], means: npt.NDArray[np.float64]
) -> None:
    a, b, c, d, e = line[:-4], line[1:-3], line[2:-2], line[3:-1], line[4:]
    for x in range(slopes.size):
        # In this order: what is left of equal pixels is as in OpenCV.
        slopes[x] = -a[x] - 2 * b[x] + 2 * d[x] + e[x]
        means[x] = a[x] + 4 * b[x] + 6 * c[x] + 4 * d[x] + e[x]


@compiled
def _weighed(
    a: npt.NDArray[np.float64],
    b: npt.NDArray[np.float64],
    c: npt.NDArray[np.float64],
    d: npt.NDArray[np.float64],
    e: npt.NDArray[np.float64],
    result: npt.NDArray[np.float32],
) -> None:
    for x in range(result.size):
        result[x] = 6 * c[x] + 4 * (d[x] + b[x]) + (e[x] + a[x])


@compiled
def _slope(
    a: npt.NDArray[np.float64],
    b: npt.NDArray[np.float64],
    d: npt.NDArray[np.float64],
    e: npt.NDArray[np.float64],
    result: npt.NDArray[np.float32],
) -> None:
    for x in range(result.size):
        result[x] = 2 * (d[x] - b[x]) + (e[x] - a[x])


@compiled
def column_votes(
    strength: npt.NDArray[np.float32],
    bins: npt.NDArray[np.float32],
    votes: npt.NDArray[np.float32],
) -> None:
    """
    Fill in how much the pixels of each column vote for each bin, one row of cells at a time.

    Parameters
    ----------
    strength : ndarray of float32, shape (P * R, X)
        Gradient strength.
    bins : ndarray of float32, shape (P * R, X)
        Orientation, counted in bins.
    votes : ndarray of float32, shape (R, B, X)
        The result.

    """
    height = strength.shape[0] // votes.shape[0]
    for row in range(votes.shape[0]):
        votes[row] = 0
        for y in range(row * height, (row + 1) * height):
            for found in range(votes.shape[1]):
                _vote(strength[y], bins[y], np.float32(found), votes[row, found])


@compiled
def _vote(
    strength: npt.NDArray[np.float32],
    bins: npt.NDArray[np.float32],
    middle: np.float32,
    votes: npt.NDArray[np.float32],
) -> None:
    for x in range(votes.size):
        share = np.float32(1) - abs(bins[x] - middle)
        votes[x] += strength[x] * max(share, np.float32(0))
