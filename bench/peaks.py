# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The most that the machine can multiply, measured: what a kernel's speed is a share of."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

from convseq_ros.core.compiled import emitted
from convseq_ros.core.similarity.kernels.instructions import int8_tile, Tile
import numpy as np

_SIDE = 1024
_ACCUMULATORS = 12
_LOOPS = 2_000_000


def sgemm_work() -> tuple[Callable[[], object], float]:
    """Return a product of two float32 matrices by BLAS, and its operations in thousands of M."""
    rng = np.random.default_rng(0)
    left, right = rng.random((2, _SIDE, _SIDE), np.float32)
    product = np.empty_like(left)
    return lambda: np.dot(left, right, out=product), 2 * _SIDE**3 / 1e9


def int8_work(threads: int) -> tuple[Callable[[], object], float] | None:
    """
    Return dot products of bytes that stay in registers, and how many operations they are.

    None if numba is absent, or the processor has no such instructions: others need three of them
    for what these do in one, so that no peak can be named.
    """
    tile = int8_tile()
    if tile is None or not tile.name.endswith('vnni'):
        return None
    run = _compiled()
    pool = ThreadPoolExecutor(threads)

    def work() -> list[int]:
        return list(pool.map(run, [_LOOPS] * threads))

    operations = 2 * 4 * tile.lanes * _ACCUMULATORS * _LOOPS * threads
    return work, operations / 1e9


@cache
def _compiled() -> Callable[[int], int]:
    import numba

    @numba.njit(nogil=True)
    def run(loops: int) -> int:
        return _dot_products(loops)

    run(1)
    return run


@emitted('int64')
def _dot_products(builder: Any, loops: Any) -> Any:
    """Return the sum of accumulators that gained a product of four bytes in every loop."""
    from llvmlite import ir
    from numba.core import cgutils

    tile = int8_tile()
    assert isinstance(tile, Tile)
    word, wide = ir.IntType(32), ir.IntType(64)
    vector = ir.VectorType(word, tile.lanes)
    kind = ir.FunctionType(vector, [vector] * 3)
    name = f'llvm.x86.avx512.vpdpbusd.{32 * tile.lanes}'
    function = cgutils.get_or_insert_function(builder.module, kind, name)
    number = builder.trunc(loops, word)
    sums, factors = [], []
    for place in range(_ACCUMULATORS + 2):
        value = builder.add(number, ir.Constant(word, 0x01030507 * (place + 1)))
        filled = ir.Constant(vector, ir.Undefined)
        for lane in range(tile.lanes):
            filled = builder.insert_element(filled, value, ir.Constant(word, lane))
        if place < _ACCUMULATORS:
            sums.append(cgutils.alloca_once_value(builder, filled))
        else:
            factors.append(filled)
    with cgutils.for_range(builder, loops):
        for one in sums:
            builder.store(builder.call(function, [builder.load(one), *factors]), one)
    total = ir.Constant(wide, 0)
    for one in sums:
        lane = builder.extract_element(builder.load(one), ir.Constant(word, 0))
        total = builder.add(total, builder.sext(lane, wide))
    return total
