# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pair scores, compiled: coherent.c, regional.c, references.c and tile.c."""

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
from convseq_ros.core.encoding.regions import (
    Cells,
    paper_regions,
    REGION,
    Regions,
    regions_in_a_row,
)
from convseq_ros.core.map.place import Packed, PACKED_UNIT
from convseq_ros.core.similarity.coherent import (
    Blocks,
    COHERENT,
    CoherentPair,
    CoherentQuery,
    Compared,
    from_products,
    GLOBAL_SIMILARITY,
    lengths,
    Wide,
)
from convseq_ros.core.similarity.kernels.numpy_kernels import NORMALIZATION, WINDOWS
from convseq_ros.core.similarity.pair_score import PairScore, QueryRegions, Scores, spread, SURE
from convseq_ros.core.types import Descriptor, Floats
import numpy as np
import numpy.typing as npt

Panel = npt.NDArray[Any]  # aligned to a cache line
# A query, and the initial values of sums over its bytes; None if it has floats.
Query = tuple[Panel, npt.NDArray[np.int32] | None]

_CACHE_LINE = 64  # bytes, of all processors with kernels
_MARGIN = 8  # of a grid of votes, as in coherent.c
# Scales of the paper's regions as bytes. Their numbers are not negative, so a reference's bytes
# start at -127. Dot products are at most 127 x 254, rounding included, and fit in 16 bits. Of 13
# pairs of scales these err least, .0012 at most, on real images with noise at 3 % of the light.
_PAPER_SCALES, _PAPER_ORIGIN = (124.0, 251.0), 127

_BYTES, _WORDS, _FLOATS, _ADDRESSES = Array('i1'), Array('i4'), Array('f4'), Array('u8')
_normalize = kernel('normalize', _FLOATS, SIZE, FLOAT, FLOAT, DOUBLE, _FLOATS)
_subtract = kernel('subtract', _FLOATS, _FLOATS, SIZE, SIZE, _FLOATS)
_pack_reference = kernel('pack_reference', _FLOATS, SIZE, FLOAT, INT, _BYTES)
_unpack_reference = kernel('unpack_reference', _BYTES, SIZE, FLOAT, _FLOATS)
_prepare = kernel(
    'prepare', _ADDRESSES, SIZE, SIZE, INT, FLOAT, FLOAT, FLOAT, DOUBLE, _FLOATS, _FLOATS,
    _FLOATS, SIZE, FLOAT, SIZE, _ADDRESSES, _BYTES,
)  # fmt: skip
_lateral_products = kernel(
    'lateral_products', _FLOATS, SIZE, SIZE, _ADDRESSES, SIZE, SIZE, Array('f8')
)
_of_coherent = (
    _WORDS, _WORDS, SIZE, SIZE, SIZE, _WORDS, _WORDS, Array('f8'), _ADDRESSES, SIZE, Array('f8'),
)  # fmt: skip
_of_regional = (
    _WORDS, SIZE, SIZE, DOUBLE, DOUBLE, DOUBLE, SIZE, _ADDRESSES, SIZE, _FLOATS,
)  # fmt: skip
# For bytes, and for floats.
_COMPARE = [kernel('compare', each, *_of_coherent) for each in (_BYTES, _FLOATS)]
_SCORE = [kernel('score', each, *_of_regional) for each in (_BYTES, _FLOATS)]

# Regions of a query and of a reference in a tile; offsets that are added to a reference's bytes
# for an origin of 0 and of 127.
_ROWS, _COLUMNS, *_ADDED = numbers('shape', 4)
_ORIGINS = 0, _PAPER_ORIGIN


def normalized(cells: Cells) -> Cells:
    """Return the definition's `normalized`, to 1e-6."""
    cells = np.ascontiguousarray(cells)
    result, weights = np.empty_like(cells), NORMALIZATION
    _normalize(cells, len(cells), weights.middle, weights.side, weights.saturation, result)
    return result


def less_background(regions: Regions, background: Regions | None) -> QueryRegions:
    """Return the definition's `less_background`, to 1e-6."""
    if background is None:
        return regions, None
    foreground, side, block = regions.copy(), isqrt(len(regions)), GLOBAL_SIMILARITY.block
    sums = np.zeros((-(-side // block),) * 2 + regions.shape[1:], np.float32)
    _subtract(foreground, np.ascontiguousarray(background, np.float32), side, block, sums)
    return foreground, sums.ravel()


def _empty_panel(size_bytes: int) -> Panel:
    room = np.empty(size_bytes + _CACHE_LINE, np.uint8)
    start = -address(room) % _CACHE_LINE
    return room[start : start + size_bytes]


def _addresses(arrays: Sequence[npt.NDArray[Any]]) -> npt.NDArray[np.uint64]:
    """Return the addresses of arrays, which the caller keeps."""
    return np.array([*map(address, arrays)], np.uint64)


def _laid_out(regions: Regions, scale: float, origin: int = 0) -> Query:
    """Return a query's regions (G, 32) as scaled signed bytes, or as floats if the scale is 0."""
    if not scale:
        return _tiled(regions, _ROWS), None
    rounded = np.clip(np.rint(_tiled(regions, _ROWS) * np.float32(scale)), -127, 127)
    start = (origin - _ADDED[_ORIGINS.index(origin)]) * rounded.sum(axis=1)
    return rounded.astype(np.int8), start.astype(np.int32)


def _in_blocks(regions: Regions, scale: float, origin: int = 0) -> Panel:
    """Return a reference's regions (N, 32) as scaled bytes, or as floats if the scale is 0."""
    count = _rounded_up(len(regions), _COLUMNS) * REGION.numbers
    if scale:
        packed = _empty_panel(count).view(np.int8)
        _pack_reference(regions, len(regions), scale, origin, packed)
        return packed
    packed = _empty_panel(4 * count).view(np.float32)
    blocks = _tiled(regions, _COLUMNS).reshape(-1, _COLUMNS, REGION.numbers)
    packed.reshape(-1, REGION.numbers, _COLUMNS)[:] = blocks.swapaxes(1, 2)
    return packed


def _tiled(rows: npt.NDArray[Any], step: int) -> npt.NDArray[Any]:
    """Return rows padded to full tiles: the last row is repeated."""
    padded = np.arange(_rounded_up(len(rows), step))
    return rows[np.minimum(padded, len(rows) - 1)]


def _rounded_up(count: int, step: int) -> int:
    return -(-count // step) * step


@dataclass(frozen=True, slots=True)
class _Reference:
    """The regions of a reference, as bytes or floats, followed by its blocks."""

    panel: Panel
    address: int  # of the panel
    count: int  # number of regions
    blocks: int  # offset of the blocks, in numbers of 4 bytes; 0 if there are none
    length: float  # of the vector of all blocks


class _CompiledCoherent(CoherentPair):
    normalize = staticmethod(normalized)
    project = staticmethod(project)
    subtract = staticmethod(less_background)

    def __init__(self, name: str) -> None:
        self._scale = REGION.byte_scale if name == 'int8' else 0.0
        super().__init__(f'{name} {library().variant}', not self._scale)

    def laid_out(self, query: CoherentQuery) -> tuple[Any, ...]:
        # In the order of `compare`: the positions in a grid of votes follow the regions.
        start = _grid(query.side)[1][_tiled(query.index, _ROWS)]
        return *_laid_out(query.regions, self._scale), start, len(query.index), query.side

    def packed(self, regions: Regions, blocks: Blocks | None) -> _Reference:
        tiles = _in_blocks(regions, self._scale)
        behind = np.zeros(0, np.float32) if blocks is None else blocks
        panel = _empty_panel(tiles.nbytes + behind.nbytes)
        np.concatenate([part.view(np.uint8).ravel() for part in (tiles, behind)], out=panel)
        begin = 0 if blocks is None else tiles.nbytes // 4
        return _Reference(panel, address(panel), len(regions), begin, float(lengths(behind)))

    def prepare_packed(
        self, packed: Sequence[Packed], normalizes: bool, background: Regions | None
    ) -> list[_Reference | None]:
        size, has_gradient, weights = len(packed[0]), np.empty(len(packed), np.int8), NORMALIZATION
        side, block, behind = regions_in_a_row(size, self.step), 0, 0
        count, each = side**2, REGION.numbers * (1 if self._scale else 4)
        room = _rounded_up(count, _COLUMNS) * each
        if background is not None:
            background = np.ascontiguousarray(self.thinned(background), np.float32)
            if self.step == 1:
                block = GLOBAL_SIMILARITY.block
                behind = (-(-side // block)) ** 2 * REGION.numbers * 4
        cells = [np.ascontiguousarray(image) for image in packed]
        panels = [_empty_panel(room + behind) for _ in packed]
        _prepare(
            _addresses(cells), len(packed), size, self.step, PACKED_UNIT, weights.middle,
            weights.side, weights.saturation if normalizes else 0.0, *axes(), background, block,
            self._scale, room, _addresses(panels), has_gradient,
        )  # fmt: skip
        references: list[_Reference | None] = []
        for panel, is_kept in zip(panels, has_gradient, strict=True):
            if not is_kept:
                references.append(None)
                continue
            if not self._scale:
                floats = panel[:room].view(np.float32)
                regions = floats[: count * REGION.numbers].reshape(-1, REGION.numbers).copy()
                floats[:] = _in_blocks(regions, 0.0)
            length = float(lengths(panel[room:].view(np.float32)))
            begin = room // 4 if behind else 0
            references.append(_Reference(panel, address(panel), count, begin, length))
        return references

    def regions_of(self, reference: _Reference) -> Regions:
        """Return the regions (N, 32) of a reference; with bytes, rounded to these."""
        panel, count = reference.panel[: 4 * reference.blocks or None], reference.count
        if not self._scale:
            blocks = panel.view(np.float32).reshape(-1, REGION.numbers, _COLUMNS).swapaxes(1, 2)
            return blocks.reshape(-1, REGION.numbers)[:count]
        regions = np.empty((count, REGION.numbers), np.float32)
        _unpack_reference(panel.view(np.int8), count, 1 / self._scale, regions)
        return regions

    def scores(
        self, query: tuple[Any, ...], wide: Wide | None, references: Sequence[_Reference]
    ) -> Compared:
        results = np.empty((len(references), 3))
        addresses = np.array([reference.address for reference in references], np.uint64)
        _, sums, *_, side = query
        half = WINDOWS[self.step][COHERENT.reach_cells :]
        compare = _COMPARE[sums is None]
        compare(*query, *_grid(side), half, addresses, len(references), results)
        similarities = None if wide is None else _similarities(wide, references, addresses)
        return results[:, 0].astype(np.float32), results[:, 1:], similarities


@cache
def _grid(side: int) -> tuple[int, npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the width of a grid of votes, positions of regions in it, and labels for all."""
    width, rows = _rounded_up(2 * side - 1, _MARGIN) + 2 * _MARGIN, np.arange(side, dtype=np.int32)
    end = _tiled((rows[:, None] * np.int32(width) + rows).ravel(), _COLUMNS)
    return width, end, np.arange(len(end) + side**2 + _ROWS, dtype=np.int32)


def _similarities(
    query: Wide, references: Sequence[_Reference], addresses: npt.NDArray[np.uint64]
) -> Floats | None:
    """Return the definition's `global_similarity`; None if a reference has no blocks."""
    if not all(reference.blocks for reference in references):
        return None
    best, begin = np.empty(len(references)), references[0].blocks
    _lateral_products(query, *query.shape[:2], addresses, begin, len(references), best)
    return from_products(best, query, np.array([reference.length for reference in references]))


class _CompiledRegional(PairScore):
    def __init__(self, name: str) -> None:
        self.name, self.exact = f'{name} {library().variant}', name == 'float32'
        self._scale, self._of_references = (0.0, 0.0) if self.exact else _PAPER_SCALES

    def extract(
        self, query: Descriptor, _least_bits: float, _regions: object
    ) -> tuple[Query, int] | None:
        if not query.informative:
            return None
        salient = spread(paper_regions(query.cells)[query.salient])
        return _laid_out(salient, self._scale, _PAPER_ORIGIN), len(salient)

    def prepare(self, cells: Cells, _background: object) -> Panel:
        return _in_blocks(paper_regions(cells), self._of_references, _PAPER_ORIGIN)

    def compare(
        self, query: tuple[Query, int], references: Sequence[Panel], limit: float | None = None
    ) -> Scores:
        scores, where = np.empty(len(references), np.float32), _addresses(references)
        (packed, count), columns = query, references[0].size // REGION.numbers
        scale = self._scale * self._of_references or 1.0
        until = (0.0, 0.0, 0) if limit is None else (limit, SURE.errors, SURE.regions)
        _SCORE[self.exact](*packed, count, columns, scale, *until, where, len(references), scores)
        return scores, None


def compiled_pair(matching: str, name: str) -> PairScore:
    """Return the kernel `float32`, exact to 1e-6, or `int8`, to 0.01 (0.0015 for the paper's)."""
    return _CompiledCoherent(name) if matching == 'coherent' else _CompiledRegional(name)
