# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How queries and references lie in memory for tiles of compiled products; see tile.c."""

from collections.abc import Sequence
from typing import Any

from convseq_ros.core.compiled import address, array, FLOAT, INT, kernel, SIZE
from convseq_ros.core.encoding.regions import Regions
import numpy as np
import numpy.typing as npt

Panel = npt.NDArray[Any]  # starts with a cache line
# A query, and what sums of its bytes begin with; None if it is floats.
Packed = tuple[Panel, npt.NDArray[np.int32] | None]

_CACHE_LINE = 64  # bytes, of all processors with kernels
_FLOATS, _BYTES = array('f4'), array('i1')
_pack_query = kernel('pack_query', _FLOATS, SIZE, FLOAT, INT, _BYTES, array('i4'))
_pack_reference = kernel('pack_reference', _FLOATS, SIZE, FLOAT, INT, _BYTES)
_pack_floats = kernel('pack_floats', _FLOATS, SIZE, INT, _FLOATS)

_shape = np.empty(4, np.int32)
kernel('shape', array('i4'))(_shape)
# Regions of a query and of a reference in a tile, and bytes of a number of a query.
ROWS, COLUMNS, QUERY_BYTES, _ = _shape.tolist()


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
    count = rounded_up(len(regions), ROWS)
    packed, start = empty_panel(count * 32 * QUERY_BYTES, np.int8), np.empty(count, np.int32)
    _pack_query(regions, len(regions), scale, origin, packed, start)
    return packed, start


def reference_bytes(regions: Regions, scale: float, origin: int = 0) -> Panel:
    """Return regions (N, 32), times a scale, as bytes in blocks."""
    packed = empty_panel(rounded_up(len(regions), COLUMNS) * 32, np.int8)
    _pack_reference(regions, len(regions), scale, origin, packed)
    return packed


def query_floats(regions: Regions) -> Packed:
    """Return regions (G, 32) up to full tiles."""
    return _floats(regions, ROWS, 0), None


def reference_floats(regions: Regions) -> Panel:
    """Return regions (N, 32) in blocks."""
    return _floats(regions, COLUMNS, 1)


def _floats(regions: Regions, step: int, reference: int) -> Panel:
    packed = empty_panel(rounded_up(len(regions), step) * 32, np.float32)
    _pack_floats(np.ascontiguousarray(regions), len(regions), reference, packed)
    return packed


def rounded_up(count: int, step: int) -> int:
    return -(-count // step) * step
