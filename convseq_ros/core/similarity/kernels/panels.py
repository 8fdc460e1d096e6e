# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a query's and a reference's regions lie in memory for the kernels: tile.c."""

from collections.abc import Sequence
from typing import Any

from convseq_ros.core.compiled import address, Array, FLOAT, kernel, numbers, SIZE
from convseq_ros.core.encoding.regions import REGION, Regions
import numpy as np
import numpy.typing as npt

Panel = npt.NDArray[Any]  # aligned to a cache line
Query = tuple[Panel, npt.NDArray[np.int32]]  # its bytes, and the initial values of their sums

_CACHE_LINE = 64  # bytes, of all processors with kernels
# Regions of a query and of a reference in a tile; what is added to a reference's bytes.
ROWS, COLUMNS, _ADDED = numbers('shape', 3)
_pack_reference = kernel('pack_reference', Array('f4'), SIZE, FLOAT, Array('i1'))


def empty_panel(size_bytes: int) -> Panel:
    """Return bytes that start at a cache line."""
    room = np.empty(size_bytes + _CACHE_LINE, np.uint8)
    start = -address(room) % _CACHE_LINE
    return room[start : start + size_bytes]


def addresses_of(arrays: Sequence[npt.NDArray[Any]]) -> npt.NDArray[np.uint64]:
    """Return the addresses of arrays, which the caller keeps."""
    return np.array([*map(address, arrays)], np.uint64)


def query_panel(regions: Regions, scale: float) -> Query:
    """Return a query's regions (G, 32) as scaled signed bytes."""
    rounded = np.clip(np.rint(tiled(regions, ROWS) * np.float32(scale)), -127, 127)
    return rounded.astype(np.int8), (-_ADDED * rounded.sum(axis=1)).astype(np.int32)


def reference_panel(regions: Regions, scale: float) -> Panel:
    """Return a reference's regions (N, 32) as scaled bytes."""
    packed = empty_panel(rounded_up(len(regions), COLUMNS) * REGION.numbers).view(np.int8)
    _pack_reference(regions, len(regions), scale, packed)
    return packed


def tiled(rows: npt.NDArray[Any], step: int) -> npt.NDArray[Any]:
    """Return rows padded to full tiles: the last row is repeated."""
    padded = np.arange(rounded_up(len(rows), step))
    return rows[np.minimum(padded, len(rows) - 1)]


def rounded_up(count: int, step: int) -> int:
    """Return the least multiple of a step that is no smaller than a count."""
    return -(-count // step) * step
