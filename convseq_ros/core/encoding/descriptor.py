# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From an image to its descriptor: cells, salient regions and entropy (paper III-B, III-C)."""

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.entropy import cell_entropies, ENTROPY, image_entropy
from convseq_ros.core.encoding.hog import cell_histograms, cell_shape, HOG
from convseq_ros.core.types import Descriptor
import cv2
import numpy as np
import numpy.typing as npt


def describe(gray: npt.NDArray[np.uint8], config: EncodingConfig = EncodingConfig()) -> Descriptor:
    """
    Return the descriptor of a grey image (H, W) of any size; its aspect ratio is not kept.

    Raises
    ------
    ValueError
        If the image is empty or not two-dimensional uint8.

    """
    if gray.ndim != 2 or gray.dtype != np.uint8 or gray.size == 0:
        raise ValueError(f'expected (H, W) uint8, got {gray.shape} {gray.dtype}')
    side = config.image_size_px
    resized = cv2.resize(gray, (side, side), interpolation=cv2.INTER_LINEAR)
    by_cell = cell_entropies(resized, side // HOG.cell_px)
    return Descriptor(
        cells=cell_histograms(resized),
        salient=salient_regions(by_cell, config.saliency_threshold),
        cell_entropy=by_cell,
        entropy=image_entropy(by_cell),
    )


def salient_regions(cells: npt.NDArray[np.float64], threshold: float) -> npt.NDArray[np.bool_]:
    """
    Return which 2 x 2-cell regions are informative, row by row: ((S - 1) ** 2,).

    Parameters
    ----------
    cells : ndarray of float64, shape (S, S)
        Mean entropy of each cell, in bits.
    threshold : float
        Share of 8 bits that the mean over a region must reach; ET in the paper.

    """
    regions = (cells[:-1, :-1] + cells[:-1, 1:] + cells[1:, :-1] + cells[1:, 1:]) / 4
    return (regions >= threshold * ENTROPY.max_bits).ravel()


def blank_descriptor(config: EncodingConfig) -> Descriptor:
    """Return the descriptor of an image without gradient, which is not informative."""
    side, _, _ = shape = cell_shape(config.image_size_px)
    return Descriptor(
        cells=np.zeros(shape, np.float32),
        salient=np.zeros((side - 1) ** 2, np.bool_),
        cell_entropy=np.zeros((side, side)),
        entropy=0.0,
    )
