# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How queries and references lie in memory for tiles of compiled products; see tile.c."""

from collections.abc import Sequence
from typing import Any

from convseq_ros.core.compiled import address, array, FLOAT, INT, kernel, numbers, SIZE
from convseq_ros.core.encoding.regions import REGION, Regions
import numpy as np
import numpy.typing as npt

Panel = npt.NDArray[Any]  # starts with a cache line
# A query, and what sums of its bytes begin with; None if it is floats.
Packed = tuple[Panel, npt.NDArray[np.int32] | None]

_CACHE_LINE = 64  # bytes, of all processors with kernels
_pack_reference = kernel('pack_reference', array('f4'), SIZE, FLOAT, INT, array('i1'))
_unpack_reference = kernel('unpack_reference', array('i1'), SIZE, FLOAT, array('f4'))

# Regions of a query and of a reference in a tile; what is added to a reference's bytes that lie
# above an origin of 0, and above one of 127.
ROWS, COLUMNS, *_ADDED = numbers('shape', 4)
_ORIGINS = 0, 127


def empty_panel(size: int, dtype: npt.DTypeLike) -> Panel:
    """Return room for so many numbers."""
    needed = size * np.dtype(dtype).itemsize
    room = np.empty(needed + _CACHE_LINE, np.uint8)
    start = -address(room) % _CACHE_LINE
    return room[start : start + needed].view(dtype)


def addresses(arrays: Sequence[npt.NDArray[Any]]) -> npt.NDArray[np.uint64]:
    """Return the addresses of arrays, which the caller keeps."""
    return np.array([*map(address, arrays)], np.uint64)


def query_bytes(regions: Regions, scale: float, origin: int = 0) -> Packed:
    """Return regions (G, 32), times a scale, as signed bytes."""
    whole = np.clip(np.rint(tiled(regions, ROWS) * np.float32(scale)), -127, 127)
    start = (origin - _ADDED[_ORIGINS.index(origin)]) * whole.sum(axis=1)
    return whole.astype(np.int8), start.astype(np.int32)


def reference_bytes(regions: Regions, scale: float, origin: int = 0) -> Panel:
    """Return regions (N, 32), times a scale, as bytes in blocks."""
    packed = empty_panel(rounded_up(len(regions), COLUMNS) * 32, np.int8)
    _pack_reference(regions, len(regions), scale, origin, packed)
    return packed


def regions_of_bytes(packed: Panel, count: int, scale: float) -> Regions:
    """Return so many regions (N, 32) of a reference from its bytes, to half a step of these."""
    regions = np.empty((count, REGION.numbers), np.float32)
    _unpack_reference(packed, count, 1 / scale, regions)
    return regions


def regions_of_floats(packed: Panel, count: int) -> Regions:
    """Return the same from its floats."""
    blocks = packed.reshape(-1, REGION.numbers, COLUMNS).swapaxes(1, 2)
    return blocks.reshape(-1, REGION.numbers)[:count]


def query_floats(regions: Regions) -> Packed:
    """Return regions (G, 32) up to full tiles."""
    return tiled(regions, ROWS), None


def reference_floats(regions: Regions) -> Panel:
    """Return regions (N, 32) in blocks."""
    packed = empty_panel(rounded_up(len(regions), COLUMNS) * 32, np.float32)
    blocks = tiled(regions, COLUMNS).reshape(-1, COLUMNS, 32)
    packed.reshape(-1, 32, COLUMNS)[:] = blocks.swapaxes(1, 2)
    return packed


def tiled(rows: npt.NDArray[Any], step: int) -> npt.NDArray[Any]:
    """Return rows up to full tiles: the last one is repeated."""
    there = np.arange(rounded_up(len(rows), step))
    return rows[np.minimum(there, len(rows) - 1)]


def rounded_up(count: int, step: int) -> int:
    return -(-count // step) * step
