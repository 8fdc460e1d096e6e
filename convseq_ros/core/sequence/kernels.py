# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coarse scores, in C: kernels.c."""

from convseq_ros.core.compiled import array, kernel, SIZE
from convseq_ros.core.types import Floats, Halves, Row
import numpy as np

_PADDED = 16  # numbers; rows are multiplied so many at a time
_products = kernel('products', array('f2'), SIZE, SIZE, array('f4'), array('f4'))


def products(rows: Halves, direction: Floats) -> Row:
    """Return the products, in float32, of rows (R, n) and a direction (n,), shape (R,)."""
    padded = np.zeros(-(-len(direction) // _PADDED) * _PADDED, np.float32)
    padded[: len(direction)] = direction
    found = np.empty(len(rows), np.float32)
    _products(np.ascontiguousarray(rows), *rows.shape, padded, found)
    return found
