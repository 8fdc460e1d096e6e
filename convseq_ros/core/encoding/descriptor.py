# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From an image to its descriptor: histograms of cells, salient regions (paper III-B, III-C)."""

from functools import cache

from convseq_ros.config import EncodingConfig
from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.encoding.entropy import cell_entropies, ENTROPY, image_entropy
from convseq_ros.core.types import constants, Descriptor, Doubles, Flags, Floats, Gray
import cv2
import numpy as np


@constants
class HOG:
    """Of the histograms (paper III-C; where it is silent, the released script)."""

    cell_px: int = 16  # W2 = H2 in the paper
    bins: int = 8  # L in the paper
    margin_px: int = 2  # beside the image; a 5 x 5 Sobel reaches so far
    hidden_bits: float = -1000.0  # entropy of a masked cell, so that no region with it is salient


# Of EncodingConfig.resize. The second gives other pixels on ARM than on x86, by 1 in 12 of 100.
INTERPOLATIONS = {'exact': cv2.INTER_LINEAR_EXACT, 'linear': cv2.INTER_LINEAR}


def describe(gray: Gray, config: EncodingConfig = EncodingConfig()) -> Descriptor:
    """
    Return that of an upright grey image of any size, made square.

    Masked cells are without gradient, and no region with one is salient. ValueError if it is not
    (H, W) uint8, or the encoding's mask is of other cells (`view.with_mask_read`).
    """
    if gray.ndim != 2 or gray.dtype != np.uint8 or gray.size == 0:
        raise ValueError(f'expected (H, W) uint8, got {gray.shape} {gray.dtype}')
    side = config.image_size_px
    interpolation = INTERPOLATIONS[config.resize]
    resized = cv2.resize(gray, (side, side), interpolation=interpolation)
    by_cell = cell_entropies(resized, side // HOG.cell_px, interpolation)
    seen = seen_cells(config.image_mask, len(by_cell))
    cells = cell_histograms(resized, seen)
    cells[~seen], by_cell[~seen] = 0, HOG.hidden_bits
    salient = salient_regions(by_cell, config.saliency_threshold)
    return Descriptor(cells, salient, by_cell, image_entropy(by_cell[seen]))


@cache
def seen_cells(mask: str, side: int) -> Flags:
    """Return which cells an encoding's mask shows, (side, side); ValueError if none of them."""
    if not mask:
        return np.ones((side, side), np.bool_)
    bits = np.unpackbits(np.frombuffer(bytes.fromhex(mask.removeprefix('#')), np.uint8))
    if not mask.startswith('#') or len(bits) != -(-(side**2) // 8) * 8:
        raise ValueError(f'image_mask: {mask[:20]!r} is not of {side} x {side} cells')
    seen = bits[: side**2].reshape(side, side).astype(np.bool_)
    if not seen.any():
        raise ValueError('image_mask: hides everything')
    return seen


def salient_regions(cells: Doubles, threshold: float) -> Flags:
    """Return where 2 x 2 cells' mean bits reach a share of 8, the paper's ET: ((S - 1) ** 2,)."""
    regions = (cells[:-1, :-1] + cells[:-1, 1:] + cells[1:, :-1] + cells[1:, 1:]) / 4
    return (regions >= threshold * ENTROPY.max_bits).ravel()


def whole_descriptor(cells: Floats) -> Descriptor:
    """Return the descriptor of a place; a map does not say what is salient, so all of it is."""
    every = np.full(cells.shape[:2], ENTROPY.max_bits)
    return Descriptor(cells, np.ones((len(cells) - 1) ** 2, np.bool_), every, 1.0)


def blank_descriptor(config: EncodingConfig) -> Descriptor:
    """Return the descriptor of an image without gradient, which is not informative."""
    side, _, _ = shape = cell_shape(config.image_size_px)
    salient = np.zeros((side - 1) ** 2, np.bool_)
    return Descriptor(np.zeros(shape, np.float32), salient, np.zeros((side, side)), 0.0)


def cell_shape(image_size_px: int) -> tuple[int, int, int]:
    """Return rows, columns and bins of the cells of a square image."""
    side = image_size_px // HOG.cell_px
    return side, side, HOG.bins


def cell_histograms(gray: Gray, seen: Flags | None = None) -> Floats:
    """
    Return the orientation histogram of every 16 x 16 px cell of an image (S, S).

    Those that are not `seen`, (S / 16, S / 16), do not decide which pixel is the brightest.

    Float32 (S / 16, S / 16, 8): sums of gradient strength, not normalised; zero if there is none.

    Notes
    -----
    As the released script, with the following choices where the paper is silent: (1) the image is
    gamma-corrected by the square root of its share of the brightest pixel; (2) gradients are 5 x 5
    Sobel; (3) strength is abs(gx + gy) / 2, not the Euclidean length; (4) orientation is signed,
    over 360 degrees, and each pixel votes for its two nearest bins linearly; (5) pixels vote in
    their own cell only. Equal pixels leave a gradient of some 1e-12 in (2), float64's rounding; it
    is kept, for a region of such cells only is scaled to unit length like any other.

    """
    cells = np.zeros(cell_shape(len(gray)), np.float32)
    brightest = float(gray.max())
    if seen is not None and not seen.all():
        shape = len(seen), HOG.cell_px, len(seen), HOG.cell_px
        brightest = float(gray.reshape(shape).max(axis=(1, 3))[seen].max())
    if brightest > 0:
        gamma = np.sqrt(np.arange(256) / brightest) * 255.0
        margin = (HOG.margin_px,) * 4
        framed = cv2.copyMakeBorder(gray, *margin, borderType=cv2.BORDER_REFLECT_101)
        kernels_of(__package__).histograms(framed, gamma, cells)
    return cells
