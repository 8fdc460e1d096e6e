# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The inner loops between stored cells and numbers, for numba to compile."""

from convseq_ros.core.compiled import compiled
import numpy as np
import numpy.typing as npt

# A half's bits, moved to where float32 has them, are a number too small by this factor.
_TOO_SMALL = 2.0**112


@compiled
def widen(
    halves: npt.NDArray[np.uint16], scale: np.float32, numbers: npt.NDArray[np.float32]
) -> None:
    """
    Fill in a multiple of finite numbers in half precision, exactly.

    Parameters
    ----------
    halves : ndarray of uint16, shape (n,)
        Their bits.
    scale : float32
        A power of two.
    numbers : ndarray of float32, shape (n,)
        The result.

    """
    bits = numbers.view(np.int32)
    for place in range(len(halves)):
        half = np.int32(halves[place])
        bits[place] = (half & 0x8000) << 16 | (half & 0x7FFF) << 13
    factor = np.float32(scale * _TOO_SMALL)
    for place in range(len(numbers)):
        numbers[place] *= factor
