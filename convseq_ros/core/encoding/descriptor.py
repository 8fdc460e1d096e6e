# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From an image to its descriptor: entropy, and histograms of cells (paper III-B, III-C)."""

from functools import cache

from convseq_ros.config import EncodingConfig
from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.encoding.entropy import cell_entropies, ENTROPY
from convseq_ros.core.types import check_gray, constants, Descriptor, Doubles, Flags, Floats, Gray
import cv2
import numpy as np


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
