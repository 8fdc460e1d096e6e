# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The inner loops between stored cells and numbers, in C; `numpy_kernels` has the same."""

from convseq_ros.core.compiled import array, FLOAT, kernel, SIZE
import numpy as np
import numpy.typing as npt

_widen = kernel('widen', array('u2'), SIZE, FLOAT, array('f4'))


def widen(
    halves: npt.NDArray[np.uint16], scale: np.float32, numbers: npt.NDArray[np.float32]
) -> None:
    """Fill in a multiple (n,), by a power of two, of numbers in half precision, given as bits."""
    _widen(np.ascontiguousarray(halves), len(halves), scale, numbers)
