# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `kernels` computes, by NumPy: the oracle, and the fallback where it is not built."""

import numpy as np
import numpy.typing as npt


def widen(
    halves: npt.NDArray[np.uint16], scale: np.float32, numbers: npt.NDArray[np.float32]
) -> None:
    """Fill in a multiple (n,) of numbers in half precision, given their bits (n,)."""
    np.multiply(halves.view(np.float16), scale, out=numbers, dtype=np.float32)
