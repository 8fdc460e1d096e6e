# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The most that the machine can multiply, measured: what a kernel's speed is a share of."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from convseq_ros.core.compiled import array, available, kernel, numbers, SIZE
import numpy as np

_SIDE = 1024
_ACCUMULATORS = 12  # of the kernel `peak`
_LOOPS = 2_000_000


def sgemm_work() -> tuple[Callable[[], object], float]:
    """Return a product of two float32 matrices by BLAS, and its operations in thousands of M."""
    rng = np.random.default_rng(0)
    left, right = rng.random((2, _SIDE, _SIDE), np.float32)
    product = np.empty_like(left)
    return lambda: np.dot(left, right, out=product), 2 * _SIDE**3 / 1e9


def int8_work(threads: int) -> tuple[Callable[[], object], float] | None:
    """Return dot products of bytes that stay in registers, and operations; None if not built."""
    if not available():
        return None
    run = kernel('peak', SIZE, array('i4'))
    pool = ThreadPoolExecutor(threads)

    def work() -> list[None]:
        return list(pool.map(run, [_LOOPS] * threads, np.empty((threads, 1), np.int32)))

    operations = 2 * numbers('shape', 6)[5] * _ACCUMULATORS * _LOOPS * threads
    return work, operations / 1e9
