# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coherent pair scores, compiled: coherent.c and references.c."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import isqrt
from typing import Any

from convseq_ros.core.compiled import (
    address,
    Array,
    DOUBLE,
    FLOAT,
    INT,
    kernel,
    library,
    numbers,
    SIZE,
)
from convseq_ros.core.encoding.kernels import axes, project
from convseq_ros.core.encoding.regions import Cells, REGION, Regions, regions_in_a_row, thinned
from convseq_ros.core.map.place import Packed, PACKED_UNIT
from convseq_ros.core.similarity.coherent import (
    Blocks,
    COHERENT,
    CoherentPair,
    CoherentQuery,
    Compared,
    Foreground,
    from_products,
    GLOBAL_SIMILARITY,
    lengths,
    Wide,
)
from convseq_ros.core.similarity.kernels.numpy_coherent import NORMALIZATION, WINDOWS
from convseq_ros.core.types import Floats
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


_SCALE = REGION.byte_scale
_MARGIN = 8  # of a grid of votes, as in coherent.c
_BYTES, _WORDS, _FLOATS, _ADDRESSES = Array('i1'), Array('i4'), Array('f4'), Array('u8')
_normalize = kernel('normalize', _FLOATS, SIZE, FLOAT, FLOAT, DOUBLE, _FLOATS)
_subtract = kernel('subtract', _FLOATS, _FLOATS, SIZE, SIZE, _FLOATS)
_unpack_reference = kernel('unpack_reference', _BYTES, SIZE, FLOAT, _FLOATS)
_prepare = kernel(
    'prepare', _ADDRESSES, SIZE, SIZE, INT, FLOAT, FLOAT, FLOAT, DOUBLE, _FLOATS, _FLOATS,
    _FLOATS, SIZE, FLOAT, SIZE, _ADDRESSES, _BYTES,
)  # fmt: skip
_lateral_products = kernel(
    'lateral_products', _FLOATS, SIZE, SIZE, _ADDRESSES, SIZE, SIZE, Array('f8')
)
_compare = kernel(
    'compare', _BYTES, _WORDS, _WORDS, SIZE, SIZE, SIZE, _WORDS, _WORDS, Array('f8'), _ADDRESSES,
    SIZE, Array('f8'),
)  # fmt: skip


def normalized(cells: Cells) -> Cells:
    """Return the definition's `normalized`, to 1e-6."""
    cells = np.ascontiguousarray(cells)
    result, weights = np.empty_like(cells), NORMALIZATION
    _normalize(cells, len(cells), weights.middle, weights.side, weights.saturation, result)
    return result


def less_background(regions: Regions, background: Regions | None) -> Foreground:
    """Return the definition's `less_background`, to 1e-6."""
    if background is None:
        return regions, None
    foreground, side, block = regions.copy(), isqrt(len(regions)), GLOBAL_SIMILARITY.block
    sums = np.zeros((-(-side // block),) * 2 + regions.shape[1:], np.float32)
    _subtract(foreground, np.ascontiguousarray(background, np.float32), side, block, sums)
    return foreground, sums.ravel()


@dataclass(frozen=True, slots=True)
class _Reference:
    """The regions of a reference, as bytes, followed by its blocks."""

    panel: Panel
    address: int  # of the panel
    count: int  # number of regions
    blocks: int  # offset of the blocks, in numbers of 4 bytes; 0 if there are none
    length: float  # of the vector of all blocks


class CompiledCoherent(CoherentPair):
    """The definition's scores, compiled."""

    normalize = staticmethod(normalized)
    project = staticmethod(project)
    subtract = staticmethod(less_background)

    def __init__(self) -> None:
        super().__init__()
        self.name = self.rough.name = library().variant

    def laid_out(self, query: CoherentQuery) -> tuple[Any, ...]:
        # In the order of `compare`: the positions in a grid of votes follow the regions.
        start = _grid(query.side)[1][tiled(query.index, ROWS)]
        return *query_panel(query.regions, _SCALE), start, len(query.index), query.side

    def packed(self, regions: Regions, blocks: Blocks | None) -> _Reference:
        tiles = reference_panel(regions, _SCALE)
        behind = np.zeros(0, np.float32) if blocks is None else blocks
        panel = empty_panel(tiles.nbytes + behind.nbytes)
        np.concatenate([part.view(np.uint8).ravel() for part in (tiles, behind)], out=panel)
        begin = 0 if blocks is None else tiles.nbytes // 4
        return _Reference(panel, address(panel), len(regions), begin, float(lengths(behind)))

    def prepare_packed(
        self, packed: Sequence[Packed], background: Regions | None
    ) -> list[_Reference | None]:
        size, has_gradient, weights = len(packed[0]), np.empty(len(packed), np.int8), NORMALIZATION
        side, block, behind = regions_in_a_row(size, self.step), 0, 0
        room = rounded_up(count := side**2, COLUMNS) * REGION.numbers
        if background is not None:
            background = np.ascontiguousarray(thinned(background, self.step), np.float32)
            if self.step == 1:
                block = GLOBAL_SIMILARITY.block
                behind = (-(-side // block)) ** 2 * REGION.numbers * 4
        cells = [np.ascontiguousarray(image) for image in packed]
        panels = [empty_panel(room + behind) for _ in packed]
        _prepare(
            addresses_of(cells), len(packed), size, self.step, PACKED_UNIT, weights.middle,
            weights.side, weights.saturation, *axes(), background, block,
            _SCALE, room, addresses_of(panels), has_gradient,
        )  # fmt: skip
        references: list[_Reference | None] = []
        for panel, is_kept in zip(panels, has_gradient, strict=True):
            if not is_kept:
                references.append(None)
                continue
            length = float(lengths(panel[room:].view(np.float32)))
            begin = room // 4 if behind else 0
            references.append(_Reference(panel, address(panel), count, begin, length))
        return references

    def regions_of(self, reference: _Reference) -> Regions:
        panel, count = reference.panel[: 4 * reference.blocks or None], reference.count
        regions = np.empty((count, REGION.numbers), np.float32)
        _unpack_reference(panel.view(np.int8), count, 1 / _SCALE, regions)
        return regions

    def scores(
        self, query: tuple[Any, ...], wide: Wide | None, references: Sequence[_Reference]
    ) -> Compared:
        results = np.empty((len(references), 3))
        addresses = np.array([reference.address for reference in references], np.uint64)
        side = query[-1]
        half = WINDOWS[self.step][COHERENT.reach_cells :]
        _compare(*query, *_grid(side), half, addresses, len(references), results)
        similarities = None if wide is None else _similarities(wide, references, addresses)
        return results[:, 0].astype(np.float32), results[:, 1:], similarities


@cache
def _grid(side: int) -> tuple[int, npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the width of a grid of votes, positions of regions in it, and labels for all."""
    width, rows = rounded_up(2 * side - 1, _MARGIN) + 2 * _MARGIN, np.arange(side, dtype=np.int32)
    end = tiled((rows[:, None] * np.int32(width) + rows).ravel(), COLUMNS)
    return width, end, np.arange(len(end) + side**2 + ROWS, dtype=np.int32)


def _similarities(
    query: Wide, references: Sequence[_Reference], addresses: npt.NDArray[np.uint64]
) -> Floats | None:
    """Return the definition's `global_similarity`; None if a reference has no blocks."""
    if not all(reference.blocks for reference in references):
        return None
    best, begin = np.empty(len(references)), references[0].blocks
    _lateral_products(query, *query.shape[:2], addresses, begin, len(references), best)
    return from_products(best, query, np.array([reference.length for reference in references]))
