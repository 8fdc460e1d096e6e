# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Normalised cells, regions less their background, and coarse scores, compiled: regions.c."""

from math import isqrt

from convseq_ros.core.compiled import array, DOUBLE, FLOAT, kernel, SIZE
from convseq_ros.core.encoding.regions import Cells, Regions
from convseq_ros.core.similarity.global_similarity import GLOBAL_SIMILARITY
from convseq_ros.core.similarity.kernels.numpy_normalization import NORMALIZATION
from convseq_ros.core.similarity.pair_score import Shown
import numpy as np
import numpy.typing as npt

_PADDED = 16  # numbers; rows are multiplied so many at a time
_FLOATS = array('f4')
_normalize = kernel('normalize', _FLOATS, SIZE, FLOAT, FLOAT, DOUBLE, _FLOATS)
_subtract = kernel('subtract', _FLOATS, _FLOATS, SIZE, SIZE, _FLOATS)
_products = kernel('products', array('f2'), SIZE, SIZE, _FLOATS, _FLOATS)


def normalized(cells: Cells) -> Cells:
    """Return what the definition's `normalized` does, to 1e-6."""
    cells = np.ascontiguousarray(cells)
    found, own = np.empty_like(cells), NORMALIZATION
    _normalize(cells, len(cells), own.middle, own.side, own.saturation, found)
    return found


def less_background(regions: Regions, background: Regions | None) -> Shown:
    """Return what the definition's `less_background` does, to 1e-6."""
    if background is None:
        return regions, None
    shown, side, block = regions.copy(), isqrt(len(regions)), GLOBAL_SIMILARITY.block
    sums = np.zeros((-(-side // block),) * 2 + regions.shape[1:], np.float32)
    _subtract(shown, np.ascontiguousarray(background, np.float32), side, block, sums)
    return shown, sums.ravel()


def products(
    rows: npt.NDArray[np.float16], direction: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Return the products, in float32, of rows (R, n) and a direction (n,), shape (R,)."""
    padded = np.zeros(-(-len(direction) // _PADDED) * _PADDED, np.float32)
    padded[: len(direction)] = direction
    found = np.empty(len(rows), np.float32)
    _products(np.ascontiguousarray(rows), *rows.shape, padded, found)
    return found
