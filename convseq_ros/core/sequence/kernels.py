# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scores along the diagonals of a whole map, and coarse scores, in C: kernels.c and coarse.c."""

from collections.abc import Sequence
import ctypes

from convseq_ros.core.compiled import address, array, kernel, SIZE
from convseq_ros.core.types import Doubles, Floats, Halves, Indices, Row
import numpy as np
import numpy.typing as npt

_PADDED = 16  # numbers; rows are multiplied so many at a time
_SIZES = array(np.intp)
_ROWS = ctypes.c_void_p, _SIZES, _SIZES, array('f4'), array('i8')  # the last: session bounds
_scores_along = kernel('scores_along', *_ROWS, SIZE, SIZE, SIZE, SIZE, array('f4'))
_products = kernel('products', array('f2'), SIZE, SIZE, array('f4'), array('f4'))


def scores_along(
    rows: Sequence[Row | None],
    steps: npt.NDArray[np.intp],
    starts: Indices,
    expected: Doubles | None,
) -> Row:
    """
    Return what `sequence_scores` does of all places, (R,), to 1e-6.

    `steps` (k,) are those of `diagonal`, newest first; sessions begin at `starts` (S,), the first
    at 0. A pair without a score counts as `expected` (k,) of its row; if None, windows are whole.
    """
    there = [frame for frame, row in enumerate(rows) if row is not None]
    shown = [np.ascontiguousarray(row, np.float32) for row in rows if row is not None]
    lengths = np.array([len(row) for row in shown], np.intp)
    partial = expected is not None
    missing = np.zeros(len(rows)) if expected is None else expected
    bounds = np.minimum(np.append(starts, lengths[0]), lengths[0])
    addresses = (ctypes.c_void_p * len(shown))(*map(address, shown))
    scores, fewest = np.empty(lengths[0], np.float32), -(-len(rows) // 2)
    reach = 0 if partial else int(steps[-1])
    given = addresses, lengths, steps[there], missing[there].astype(np.float32), bounds
    _scores_along(*given, len(shown), fewest, reach, not partial, scores)
    return scores


def products(rows: Halves, direction: Floats) -> Row:
    """Return the products, in float32, of rows (R, n) and a direction (n,), shape (R,)."""
    padded = np.zeros(-(-len(direction) // _PADDED) * _PADDED, np.float32)
    padded[: len(direction)] = direction
    found = np.empty(len(rows), np.float32)
    _products(np.ascontiguousarray(rows), *rows.shape, padded, found)
    return found
