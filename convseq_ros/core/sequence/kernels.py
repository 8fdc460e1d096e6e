# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scores along diagonals at several velocities, in C: kernels.c; `numpy_kernels` has the same."""

from collections.abc import Sequence
import ctypes

from convseq_ros.core.compiled import array, kernel, SIZE
from convseq_ros.core.types import Row
import numpy as np
import numpy.typing as npt

_SIZES = array(np.intp)
_peaks = kernel(
    'peaks', ctypes.c_void_p, _SIZES, _SIZES, _SIZES, SIZE, SIZE, SIZE,
    array('f4'), array('f8'), array('i8'),
)  # fmt: skip


def peaks(rows: Sequence[Row | None], steps: npt.NDArray[np.intp]) -> npt.NDArray[np.float64]:
    """Return what the twin of `numpy_kernels` does, to 1e-6."""
    there = [frame for frame, row in enumerate(rows) if row is not None]
    shown = [np.ascontiguousarray(row, np.float32) for row in rows if row is not None]
    addresses = (ctypes.c_void_p * len(shown))(*(row.ctypes.data for row in shown))
    lengths = np.array([len(row) for row in shown], np.intp)
    highest = np.empty(len(steps), np.float32)
    means, counts = np.empty(len(steps)), np.empty(len(steps), np.int64)
    reaches, met = np.ascontiguousarray(steps[:, -1]), np.ascontiguousarray(steps[:, there])
    fewest = max(1, -(-len(rows) // 2))
    _peaks(addresses, lengths, met, reaches, *met.shape, fewest, highest, means, counts)
    return np.column_stack((highest, means, counts))
