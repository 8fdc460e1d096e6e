# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From an image to its descriptor: entropy, and histograms of cells (paper III-B, III-C)."""

from functools import cache
from math import isqrt

from convseq_ros.config import EncodingConfig
from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.types import (
    check_gray,
    constants,
    Descriptor,
    Doubles,
    Flags,
    Floats,
    Gray,
    Indices,
)
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


@constants
class HOG:
    """The histograms (paper III-C, and the released script for what it does not state)."""

    cell_px: int = 16  # W2 = H2 in the paper
    bins: int = 8  # L in the paper
    margin_px = 5 // 2  # on each side of the image, for a 5 x 5 Sobel filter
    hidden_bits: float = -1000.0  # entropy of a masked cell, so that no region with it is salient


# By EncodingConfig.resize. With the second, 12 % of pixels differ by 1 between ARM and x86.
INTERPOLATIONS = {'exact': cv2.INTER_LINEAR_EXACT, 'linear': cv2.INTER_LINEAR}


def describe(gray: Gray, config: EncodingConfig = EncodingConfig()) -> Descriptor:
    """
    Return the descriptor of an upright grey image of any size, which is scaled to a square.

    Masked cells have no gradient, and no region with one is salient. ValueError if the image is
    not (H, W) uint8, or the mask is of a different number of cells (`mask.masked`).
    """
    check_gray(gray)
    side = config.image_size_px
    interpolation = INTERPOLATIONS[config.resize]
    resized = cv2.resize(gray, (side, side), interpolation=interpolation)
    by_cell = cell_entropies(resized, side // HOG.cell_px, interpolation)
    visible = visible_cells(config.image_mask, len(by_cell))
    cells = cell_histograms(resized, visible)
    cells[~visible], by_cell[~visible] = 0, HOG.hidden_bits
    salient = salient_regions(by_cell, config.saliency_threshold)
    entropy = float(by_cell[visible].mean()) / ENTROPY.max_bits
    return Descriptor(cells, salient, by_cell, entropy)


@cache
def visible_cells(mask: str, side: int) -> Flags:
    """Return which cells an encoding's mask shows, (side, side); ValueError if it shows none."""
    if not mask:
        return np.ones((side, side), np.bool_)
    bits = np.unpackbits(np.frombuffer(bytes.fromhex(mask.removeprefix('#')), np.uint8))
    if not mask.startswith('#') or len(bits) != -(-(side**2) // 8) * 8:
        raise ValueError(f'image_mask: {mask[:20]!r} is not of {side} x {side} cells')
    visible = bits[: side**2].reshape(side, side).astype(np.bool_)
    if not visible.any():
        raise ValueError('image_mask: hides everything')
    return visible


def mask_of(visible: Flags) -> str:
    """Return the mask of an encoding that shows cells (S, S); empty if it shows all."""
    return '' if visible.all() else f'#{np.packbits(visible).tobytes().hex()}'


def whole_cells(shown: Flags) -> Flags:
    """Return which cells (S, S) a square image shows entirely, and 2 px around, by its pixels."""
    around = np.ones((2 * HOG.margin_px + 1,) * 2, np.uint8)
    whole = cv2.erode(shown.astype(np.uint8), around, borderValue=1)
    side = len(whole) // HOG.cell_px
    cells: Flags = whole.reshape(side, HOG.cell_px, side, -1).all(axis=(1, 3))
    return cells


def salient_regions(cells: Doubles, threshold: float) -> Flags:
    """Return which 2 x 2 cells, ((S - 1) ** 2,), reach a mean share of 8 bits, the paper's ET."""
    regions = (cells[:-1, :-1] + cells[:-1, 1:] + cells[1:, :-1] + cells[1:, 1:]) / 4
    return (regions >= threshold * ENTROPY.max_bits).ravel()


def whole_descriptor(cells: Floats) -> Descriptor:
    """Return the descriptor of a place; all regions are salient, as maps store no entropy."""
    entropy = np.full(cells.shape[:2], ENTROPY.max_bits)
    return Descriptor(cells, np.ones((len(cells) - 1) ** 2, np.bool_), entropy, 1.0)


def blank_descriptor(config: EncodingConfig) -> Descriptor:
    """Return the uninformative descriptor of an image without gradient."""
    side, _, _ = shape = cell_shape(config.image_size_px)
    salient = np.zeros((side - 1) ** 2, np.bool_)
    return Descriptor(np.zeros(shape, np.float32), salient, np.zeros((side, side)), 0.0)


def cell_shape(image_size_px: int) -> tuple[int, int, int]:
    """Return rows, columns and bins of the cells of a square image."""
    side = image_size_px // HOG.cell_px
    return side, side, HOG.bins


def cell_histograms(gray: Gray, visible: Flags | None = None) -> Floats:
    """
    Return the orientation histograms of the 16 x 16 px cells of an image (S, S).

    Only `visible` cells, (S / 16, S / 16), are searched for the brightest pixel.

    The result is float32 (S / 16, S / 16, 8): sums of gradient strength, not normalised.

    Notes
    -----
    As the released script, with these choices, which the paper does not state: (1) the image is
    gamma-corrected by the square root of its share of the brightest pixel; (2) gradients are 5 x 5
    Sobel; (3) strength is abs(gx + gy) / 2, not the Euclidean length; (4) orientation is signed,
    over 360 degrees, and each pixel votes for its two nearest bins linearly; (5) pixels vote in
    their own cell only. Equal pixels leave a gradient of about 1e-12 in (2), by rounding. It is
    kept: a region of only such cells is scaled to unit length like any other.

    """
    cells = np.zeros(cell_shape(len(gray)), np.float32)
    brightest = float(gray.max())
    if visible is not None and not visible.all():
        shape = len(visible), HOG.cell_px, len(visible), HOG.cell_px
        brightest = float(gray.reshape(shape).max(axis=(1, 3))[visible].max())
    if brightest > 0:
        gamma = np.sqrt(np.arange(256) / brightest) * 255.0
        margin = (HOG.margin_px,) * 4
        framed = cv2.copyMakeBorder(gray, *margin, borderType=cv2.BORDER_REFLECT_101)
        kernels_of(__package__).histograms(framed, gamma, cells)
    return cells
