# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Local entropy: which parts of an image carry information (paper III-B)."""

from functools import cache
from math import isqrt

from convseq_ros.core.compiled import available
import cv2
import numpy as np
import numpy.typing as npt

MAX_BITS = 8.0
_SIDE_PX = 100
_RADIUS_PX = 5
_OUTSIDE = 256
_STEP = 2.0**-42

Numbers = npt.NDArray[np.float64]


def entropy_map(gray: npt.NDArray[np.uint8]) -> Numbers:
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
    resized image and enlarged again. It is that of `skimage.filters.rank.entropy`: what of the
    disk lies beyond the image's edge does not count.

    """
    return cv2.resize(_local_entropy(gray), gray.shape[::-1], interpolation=cv2.INTER_LINEAR)


def cell_entropies(gray: npt.NDArray[np.uint8], cells: int) -> Numbers:
    """
    Return the mean of an image's entropy map over each cell, without the map.

    Parameters
    ----------
    gray : ndarray of uint8, shape (S, S)
        The image, already resized.
    cells : int
        Cells in a row of the image, C; S is a multiple.

    Returns
    -------
    ndarray of float64, shape (C, C)
        In bits, as in `entropy_map`.

    """
    enlarged = _enlarged_means(gray.shape[0], cells)
    return enlarged @ _local_entropy(gray) @ enlarged.T


@cache
def _enlarged_means(side: int, cells: int) -> Numbers:
    """Return (C, 100): what each row of the small copy adds to the mean of each row of cells."""
    rows = cv2.resize(np.eye(_SIDE_PX), (_SIDE_PX, side), interpolation=cv2.INTER_LINEAR)
    return rows.reshape(cells, side // cells, _SIDE_PX).mean(axis=1)


def image_entropy(bits: Numbers) -> float:
    """Return the mean of an entropy map, or of its cells, as a share of 8 bits, in [0, 1]."""
    return float(bits.mean()) / MAX_BITS


def _local_entropy(gray: npt.NDArray[np.uint8]) -> Numbers:
    """
    Return the entropy over a disk around every pixel of a 100 x 100 copy.

    With c pixels of each level and n in all it is log2 n - sum(c log2 c) / n. Beyond the edge lies
    one more level, whose part of the sum is known.
    """
    small = cv2.resize(gray, (_SIDE_PX, _SIDE_PX), interpolation=cv2.INTER_LINEAR)
    framed = np.full([length + 2 * _RADIUS_PX for length in small.shape], _OUTSIDE, np.uint16)
    framed[_RADIUS_PX:-_RADIUS_PX, _RADIUS_PX:-_RADIUS_PX] = small
    if available():
        from convseq_ros.core.encoding.kernels import disk_sums

        sums = np.empty(small.shape)
        disk_sums(framed, _half_widths(), _terms(), sums)
    else:
        sums = _disk_sums(framed)
    of_whole, of_outside, count = _edge(small.shape)
    return (of_whole - (sums - of_outside)) / count


@cache
def _half_widths() -> npt.NDArray[np.int64]:
    """Return how many pixels of the disk lie right of its middle, row by row."""
    rows = range(-_RADIUS_PX, _RADIUS_PX + 1)
    return np.array([isqrt(_RADIUS_PX**2 - y**2) for y in rows])


@cache
def _terms() -> Numbers:
    """
    Return c log2 c for every count c of pixels of a disk.

    Multiples of one step, so that any sum of them is exact, in whatever order.
    """
    count = np.arange(1 + (2 * _half_widths() + 1).sum())
    return np.rint(count * np.log2(count.clip(1)) / _STEP) * _STEP


@cache
def _edge(shape: tuple[int, int]) -> tuple[Numbers, Numbers, npt.NDArray[np.int64]]:
    """Return c log2 c of pixels of the disk inside and outside the image, and the former."""
    columns = np.arange(-_RADIUS_PX, _RADIUS_PX + 1)
    disk = (abs(columns) <= _half_widths()[:, None]).astype(np.float64)
    inside = cv2.filter2D(np.ones(shape), -1, disk, borderType=cv2.BORDER_CONSTANT)
    count = np.rint(inside).astype(np.int64)
    terms = _terms()
    return terms[count], terms[terms.size - 1 - count], count


def _disk_sums(framed: npt.NDArray[np.uint16]) -> Numbers:
    """
    Return the sum of c log2 c over a disk around every pixel, without loops over pixels.

    The n-th pixel of its level, in reading order, adds n log2 n - (n - 1) log2 (n - 1). So for one
    pixel of the disk after the other the equal ones before it are counted, around all pixels of
    the image at once. Those in a row of the disk are a difference of two running sums along a row
    of the image, which serve many pixels of the disk.
    """
    height, width = (length - 2 * _RADIUS_PX for length in framed.shape)
    line, size = framed.shape[1], framed.size
    reach = 2 * _RADIUS_PX
    slack = np.full(reach * line + reach, _OUTSIDE, np.uint16)
    flat = np.concatenate([slack, framed.ravel(), slack[:reach]])
    here = flat[slack.size : slack.size + size]
    halves = _half_widths()
    middle = halves.cumsum() * 2 - halves + np.arange(halves.size)
    rank = np.ones((_terms().size - 1, height * line), np.uint8)
    equal = np.zeros((2 * reach + 2, size + reach), np.uint8)
    for up in range(reach + 1):
        shifts = range(-reach, reach + 1 if up else 0)
        for index, shift in enumerate(shifts):
            start = slack.size - up * line + shift
            same = (flat[start : start + size] == here).view(np.uint8)
            np.add(equal[index, :size], same, out=equal[index + 1, :size])
        for row in range(up, halves.size):
            half = halves[row - up]
            for x in range(-halves[row], halves[row] + 1):
                start = row * line + _RADIUS_PX + x
                counted = equal[:, start : start + height * line]
                first, end = -half - x, half - x + 1 if up else 0
                of_pixel = rank[middle[row] + x]
                of_pixel += counted[reach + end]
                of_pixel -= counted[reach + first]
    added = np.zeros(256)
    added[1 : _terms().size] = np.diff(_terms())
    sums = np.zeros((height, line))
    for of_pixel in rank.reshape(-1, height, line):
        sums += cv2.LUT(of_pixel, added)
    return sums[:, :width]
