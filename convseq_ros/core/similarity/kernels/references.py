# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""References as coherent pairs are compared, many at a time: references.c."""

from collections.abc import Sequence

from convseq_ros.core.compiled import array, DOUBLE, FLOAT, kernel, SIZE
from convseq_ros.core.encoding.kernels import axes
from convseq_ros.core.encoding.regions import REGION, Regions
from convseq_ros.core.map.place import Packed, PACKED_UNIT
from convseq_ros.core.similarity.global_similarity import Blocks, from_products, GLOBAL_SIMILARITY
from convseq_ros.core.similarity.kernels.numpy_normalization import NORMALIZATION
from convseq_ros.core.similarity.kernels.panel import (
    addresses,
    COLUMNS,
    empty_panel,
    Panel,
    reference_bytes,
    reference_floats,
    rounded_up,
)
import numpy as np
import numpy.typing as npt

_FLOATS, _ADDRESSES = array('f4'), array('u8')
_prepare = kernel(
    'prepare', _ADDRESSES, SIZE, SIZE, FLOAT, FLOAT, FLOAT, DOUBLE, _FLOATS, _FLOATS, _FLOATS,
    SIZE, FLOAT, _ADDRESSES, array('i1'),
)  # fmt: skip
_lateral_products = kernel(
    'lateral_products', _FLOATS, SIZE, SIZE, _ADDRESSES, SIZE, SIZE, array('f8')
)


def pack(regions: Regions, blocks: Blocks | None, scale: float) -> Panel:
    """Return a reference's regions, as bytes if there is a scale, and its blocks behind them."""
    shown = reference_bytes(regions, scale) if scale else reference_floats(regions)
    behind = np.zeros(0, np.float32) if blocks is None else blocks
    panel = empty_panel(shown.nbytes + behind.nbytes, np.uint8)
    panel[: shown.nbytes], panel[shown.nbytes :] = shown.view(np.uint8), behind.view(np.uint8)
    return panel.view(shown.dtype)


def pack_all(
    packed: Sequence[Packed], normalizes: bool, background: Regions | None, scale: float
) -> list[Panel | None]:
    """Return what `pack` does of each reference, from its packed cells; None without gradient."""
    size, shown = len(packed[0]), np.empty(len(packed), np.int8)
    dtype = np.dtype(np.int8 if scale else np.float32)
    side, own, block = size - REGION.span + 1, NORMALIZATION, GLOBAL_SIMILARITY.block
    room = _room(side)
    if background is not None:
        background = np.ascontiguousarray(background, np.float32)
        room += (-(-side // block)) ** 2 * REGION.numbers * background.itemsize // dtype.itemsize
    packed = [np.ascontiguousarray(one) for one in packed]
    panels = [empty_panel(room, dtype) for _ in packed]
    _prepare(
        addresses(packed), len(packed), size, PACKED_UNIT, own.middle, own.side,
        own.saturation if normalizes else 0.0, *axes(), background, block, scale,
        addresses(panels), shown,
    )  # fmt: skip
    return [panel if any_ else None for panel, any_ in zip(panels, shown.tolist(), strict=True)]


def alike(
    blocks: Blocks, side: int, references: Sequence[Panel]
) -> npt.NDArray[np.float32] | None:
    """Return global similarities, as the definition does; None if a reference has no blocks."""
    count = -(-side // GLOBAL_SIMILARITY.block)
    behind = _room(side) * references[0].itemsize // blocks.itemsize
    if any(one.nbytes == behind * blocks.itemsize for one in references):
        return None
    best, most = np.empty(len(references)), min(GLOBAL_SIMILARITY.most_shift, count - 1)
    _lateral_products(blocks, count, most, addresses(references), behind, len(references), best)
    return from_products(best)


def _room(side: int) -> int:
    """Return how many numbers a reference's regions take."""
    return rounded_up(side**2, COLUMNS) * REGION.numbers
