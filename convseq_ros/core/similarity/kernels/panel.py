# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What compiled functions read of queries and references: words, laid out for tiles."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

from convseq_ros.core.compiled import compiled
from convseq_ros.core.similarity.kernels.instructions import Tile
import numpy as np
import numpy.typing as npt

_CACHE_LINE = 64  # bytes, of all processors with a tile here


@dataclass(frozen=True, slots=True)
class Panel:
    """
    An array that stays where it is, and its address.

    Parameters
    ----------
    array : ndarray
        C-contiguous; starts with a cache line.
    address : int
        Of its first number.

    """

    array: npt.NDArray[Any]
    address: int


def empty_panel(shape: tuple[int, ...], dtype: npt.DTypeLike) -> Panel:
    """Return room that compiled functions can address."""
    needed = math.prod(shape) * np.dtype(dtype).itemsize
    room = np.empty(needed + _CACHE_LINE, np.uint8)
    place = room.__array_interface__['data'][0]
    start = -place % _CACHE_LINE
    return Panel(room[start : start + needed].view(dtype).reshape(shape), place + start)


def panel_of(values: npt.NDArray[Any]) -> Panel:
    """Return a copy that compiled functions can address."""
    panel = empty_panel(values.shape, values.dtype)
    panel.array[...] = values
    return panel


def addresses(panels: Sequence[Panel]) -> npt.NDArray[np.int64]:
    """Return the addresses of panels, which the caller keeps."""
    return np.array([one.address for one in panels], np.int64)


def query_words(rows: npt.NDArray[Any], tile: Tile) -> Panel:
    """Return the rows (G, n) of a query as words; the last is repeated until tiles are full."""
    return panel_of(_filled(_as_words(rows), tile.rows))


def reference_words(rows: npt.NDArray[Any], tile: Tile) -> Panel:
    """Return the regions (N, n) of a reference as words, in blocks; the last is repeated."""
    words = _filled(_as_words(rows), tile.columns)
    return panel_of(words.reshape(-1, tile.columns, words.shape[1]).transpose(0, 2, 1))


def _as_words(rows: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return rows if rows.dtype == np.float32 else rows.view(np.int32)


def _filled(rows: npt.NDArray[Any], step: int) -> npt.NDArray[Any]:
    return rows[np.minimum(np.arange(-(-len(rows) // step) * step), len(rows) - 1)]


def quantised(
    rows: npt.NDArray[np.float32], scale: float, most: int, offset: int | None = None
) -> npt.NDArray[np.int8 | np.uint8]:
    """Return rows as bytes: scaled, clipped to +-most and, if raised by an offset, unsigned."""
    whole = rows * np.float32(scale)
    np.rint(whole, out=whole)
    np.clip(whole, -most, most, out=whole)
    if offset is None:
        return whole.astype(np.int8)
    whole += offset
    return whole.astype(np.uint8)


@compiled
def address(array):  # type: ignore[no-untyped-def]
    """Return the address of an array in compiled functions, signed as their other numbers."""
    return np.int64(array.ctypes.data)


@compiled
def aligned(count):  # type: ignore[no-untyped-def]
    """Return float32 zeros that start with a cache line, in compiled functions."""
    room = np.zeros(count + _CACHE_LINE // 4, np.float32)
    start = -address(room) % _CACHE_LINE // 4
    return room[start : start + count]
