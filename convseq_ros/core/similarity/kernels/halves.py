# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Products of many rows of numbers in half precision with one, compiled."""

from typing import Any

from convseq_ros.core.compiled import compiled, emitted
from convseq_ros.core.similarity.kernels.panel import address
from convseq_ros.core.similarity.kernels.tile import FLOATS
from convseq_ros.core.similarity.kernels.vectors import Vectors
import numpy as np
import numpy.typing as npt

_LANES = FLOATS.lanes
# A half's bits, moved to where float32 has them, are a number too small by this factor.
_TOO_SMALL = 2.0**112


def products(
    halves: npt.NDArray[np.float16], direction: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Return the products of rows (R, n) and a direction (n,), of 16 finite numbers or more."""
    count = halves.shape[1]
    # The last vector ends with the row, and says again what the one before has said already.
    whole = (count - 1) // _LANES
    weights = np.zeros((whole + 1) * _LANES, np.float32)
    weights[: whole * _LANES] = direction[: whole * _LANES]
    weights[whole * _LANES - count :] = direction[whole * _LANES :]
    weights *= np.float32(_TOO_SMALL)
    row = np.empty(len(halves), np.float32)
    _multiply(halves.view(np.uint16), weights, whole, row)
    return row


@compiled
def _multiply(halves, weights, whole, row):  # type: ignore[no-untyped-def]
    stride = 2 * halves.shape[1]
    for index in range(len(row)):
        start = address(halves) + index * stride
        row[index] = _dot(start, address(weights), whole, start + stride - 2 * _LANES)


@emitted('float32')
def _dot(builder: Any, halves: Any, weights: Any, whole: Any, last: Any) -> Any:
    """Return the product of some vectors side by side, and of one elsewhere; addresses."""
    write = Vectors(builder, FLOATS)
    packed = write.ir.VectorType(write.ir.IntType(16), FLOATS.lanes)

    def added(total: Any, halves: Any, weights: Any) -> Any:
        wide = builder.sext(write.load(packed, halves), write.words)
        # The sign stays on top; exponent and fraction are put below it.
        bits = builder.shl(wide, write.constant(13))
        bits = builder.and_(bits, write.constant(-0x7000_2000))
        number = builder.bitcast(bits, write.numbers)
        return write.added(total, number, write.load(write.numbers, weights))

    total = write.help.alloca_once_value(builder, write.ir.Constant(write.numbers, None))
    with write.help.for_range(builder, whole) as loop:
        step = builder.mul(loop.index, write.ir.Constant(loop.index.type, 2 * FLOATS.lanes))
        own = builder.add(weights, builder.add(step, step))
        builder.store(added(builder.load(total), builder.add(halves, step), own), total)
    size = builder.mul(whole, write.ir.Constant(whole.type, 4 * FLOATS.lanes))
    return write.total(added(builder.load(total), last, builder.add(weights, size)))
