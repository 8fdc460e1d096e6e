# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `kernels` computes, by NumPy: the oracle, and the fallback where it is not built."""

import numpy as np
import numpy.typing as npt

_TOP = np.uint8(128)  # the top bit of a byte


def join_bytes(stored: npt.NDArray[np.uint8], halves: npt.NDArray[np.uint16]) -> None:
    """Fill in the bits (n, 8) of stored cells (15, n); see `format`."""
    upper = stored[8:]
    halves[:, :-1] = (upper & ~_TOP).T
    halves[:, -1] = np.packbits(upper >= _TOP, axis=0, bitorder='little')[0]
    halves <<= 8
    halves |= stored[:8].T


def widen(
    halves: npt.NDArray[np.uint16], scale: np.float32, numbers: npt.NDArray[np.float32]
) -> None:
    """Fill in a multiple (n,) of numbers in half precision, given their bits (n,)."""
    np.multiply(halves.view(np.float16), scale, out=numbers, dtype=np.float32)
