# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The local entropy of an image (paper III-B)."""

from functools import cache
from math import isqrt

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.types import constants, Doubles, Gray, Indices
import cv2
import numpy as np


@constants
class ENTROPY:
    """The local entropy (paper III-B, and the released script for what it does not state)."""

    max_bits = float(np.iinfo(np.uint8).bits)  # of a pixel; entropy is given as a share of them
    side_px: int = 100  # of the small copy that entropy is computed on
    radius_px: int = 5  # of the disk around a pixel
    outside = int(2**max_bits)  # level of pixels beyond the image
    # Bits; terms are multiples of it, so that any sum of them, below 2 ** 11, is exact in float64.
    step = 2.0 ** (11 - 53)
    resolution: float = 2.0**-32  # bits; saliency must not depend on the order of addition


def cell_entropies(gray: Gray, cells: int, interpolation: int = cv2.INTER_LINEAR_EXACT) -> Doubles:
    """
    Return the mean local entropy of a square image in each of C x C cells, (C, C), in bits.

    As the released script, not the paper's text: `skimage.filters.rank.entropy` of a 100 x 100
    copy, enlarged again; pixels beyond the image's edge do not count.
    """
    enlarged = _enlarged_means(gray.shape[0], cells)
    bits = enlarged @ local_entropy(gray, interpolation) @ enlarged.T
    return np.rint(bits / ENTROPY.resolution) * ENTROPY.resolution


@cache
def _enlarged_means(side: int, cells: int) -> Doubles:
    """Return (C, 100): the weight of each row of the small copy in each row of cells."""
    size = ENTROPY.side_px
    rows = cv2.resize(np.eye(size), (size, side), interpolation=cv2.INTER_LINEAR)
    return rows.reshape(cells, side // cells, size).mean(axis=1)


def local_entropy(gray: Gray, interpolation: int = cv2.INTER_LINEAR_EXACT) -> Doubles:
    """
    Return the entropy of a disk around every pixel of a 100 x 100 copy, in [0, 6.34] bits.

    With c pixels of each level and n in all, it is log2 n - sum(c log2 c) / n. Pixels beyond the
    edge have an additional level, whose part of the sum is known and subtracted.
    """
    size, radius = ENTROPY.side_px, ENTROPY.radius_px
    framed = np.full((size + 2 * radius, size + 2 * radius), ENTROPY.outside, np.uint16)
    small = cv2.resize(gray, (size, size), interpolation=interpolation)
    framed[radius:-radius, radius:-radius] = small
    half_widths, terms, of_whole, of_outside, count = _disk()
    sums = np.empty((size, size))
    kernels_of(__package__).disk_sums(framed, half_widths, terms, sums)
    return (of_whole - (sums - of_outside)) / count


@cache
def _disk() -> tuple[Indices, Doubles, Doubles, Doubles, Indices]:
    """Return the half widths of rows; c log2 c for all c, c inside, c outside; and c inside."""
    radius, size = ENTROPY.radius_px, ENTROPY.side_px
    away = np.arange(-radius, radius + 1)
    half_widths = np.array([isqrt(radius**2 - y**2) for y in away.tolist()])
    counts = np.arange(1 + (2 * half_widths + 1).sum())
    terms = np.rint(counts * np.log2(counts.clip(1)) / ENTROPY.step) * ENTROPY.step
    disk = (abs(away) <= half_widths[:, None]).astype(np.float64)
    covered = cv2.filter2D(np.ones((size, size)), -1, disk, borderType=cv2.BORDER_CONSTANT)
    inside = np.rint(covered).astype(np.int64)  # pixels of the disk around each pixel
    return half_widths, terms, terms[inside], terms[terms.size - 1 - inside], inside
