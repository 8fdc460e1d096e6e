# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From an image to its descriptor: cells, salient regions and entropy (paper III-B, III-C)."""

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.entropy import cell_entropies, image_entropy, MAX_BITS
from convseq_ros.core.encoding.hog import BINS, cell_histograms, CELL_PX
from convseq_ros.core.types import Descriptor
import cv2
import numpy as np
import numpy.typing as npt


def describe(gray: npt.NDArray[np.uint8], config: EncodingConfig = EncodingConfig()) -> Descriptor:
    """
    Return the descriptor of a grey image of any size.

    Parameters
    ----------
    gray : ndarray of uint8, shape (H, W)
        The image; its aspect ratio is not kept.
    config : EncodingConfig
        Size and saliency.

    Raises
    ------
    ValueError
        If the image is empty or not two-dimensional uint8.

    """
    if gray.ndim != 2 or gray.dtype != np.uint8 or gray.size == 0:
        raise ValueError(f'expected (H, W) uint8, got {gray.shape} {gray.dtype}')
    side = config.image_size_px
    resized = cv2.resize(gray, (side, side), interpolation=cv2.INTER_LINEAR)
    by_cell = cell_entropies(resized, side // CELL_PX)
    return Descriptor(
        cells=cell_histograms(resized),
        salient=salient_regions(by_cell, config.saliency_threshold),
        cell_entropy=by_cell,
        entropy=image_entropy(by_cell),
    )


def salient_regions(cells: npt.NDArray[np.float64], threshold: float) -> npt.NDArray[np.bool_]:
    """
    Return which overlapping 2 x 2-cell regions are informative.

    Parameters
    ----------
    cells : ndarray of float64, shape (C, C)
        Mean entropy of each cell, in bits.
    threshold : float
        Share of 8 bits that the mean over a region must reach; ET in the paper.

    Returns
    -------
    ndarray of bool, shape ((C - 1) ** 2,)
        Row by row.

    """
    regions = (cells[:-1, :-1] + cells[:-1, 1:] + cells[1:, :-1] + cells[1:, 1:]) / 4
    return (regions >= threshold * MAX_BITS).ravel()


def nothing_seen(config: EncodingConfig) -> Descriptor:
    """Return the descriptor of a frame that could not be read: it holds its place, no more."""
    side = config.image_size_px // CELL_PX
    return Descriptor(
        cells=np.zeros((side, side, BINS), np.float32),
        salient=np.zeros((side - 1) ** 2, np.bool_),
        cell_entropy=np.zeros((side, side)),
        entropy=0.0,
    )
