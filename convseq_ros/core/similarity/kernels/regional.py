# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Regional pair scores, compiled: the best counterparts by cells, or by tiles of bytes."""

from collections.abc import Sequence
from dataclasses import dataclass

from convseq_ros.core.compiled import compiled
from convseq_ros.core.similarity.kernels.panel import (
    address,
    addresses,
    aligned,
    Panel,
    panel_of,
    quantised,
    query_words,
    reference_words,
)
from convseq_ros.core.similarity.kernels.tile import (
    best_block,
    BYTE_WORDS,
    BYTES,
    CELL_WORDS,
    FLOATS,
    keep_cell_dots,
    keep_maxima,
    maximum,
)
from convseq_ros.core.similarity.pair_score import PairScore, Scores
from convseq_ros.core.similarity.regional import regions
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

# Sums of two products fit into 16 bits, which some instructions need.
_QUERY_SCALE, _REFERENCE_SCALE = 127, 255
_LANES, _ROWS, _COLUMNS = BYTES.lanes, BYTES.rows, BYTES.columns
_FLOAT_LANES, _FLOAT_ROWS, _FLOAT_COLUMNS = FLOATS.lanes, FLOATS.rows, FLOATS.columns

Cells = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class _Cells:
    """A query's cells, and the inverse lengths of its regions, 0 where not salient, (S * S,)."""

    words: Panel
    inverse: npt.NDArray[np.float32]
    count: int
    side: int


@dataclass(frozen=True, slots=True)
class _Bytes:
    """A query's salient regions."""

    words: Panel
    count: int


def _inverse_lengths(cells: Cells) -> npt.NDArray[np.float32]:
    """Return one over the length of each region, in the place of its first cell; 0 elsewhere."""
    squares = np.einsum('rcb,rcb->rc', cells, cells)
    rows = squares[:-1] + squares[1:]
    length = np.sqrt(rows[:, :-1] + rows[:, 1:])
    inverse = np.zeros(cells.shape[:2], np.float32)
    np.divide(1, length, out=inverse[:-1, :-1], where=length > 0)
    return inverse


def _see_cells(query: Descriptor, _least_bits: float, _usual: object) -> _Cells | None:
    if not query.informative:
        return None
    side = len(query.cells)
    inverse = _inverse_lengths(query.cells)
    salient = query.salient.reshape(side - 1, side - 1)
    inverse[:-1, :-1] *= salient
    words = query_words(query.cells.reshape(side * side, -1), FLOATS)
    return _Cells(words, inverse.ravel(), int(salient.sum()), side)


def _cells_of(cells: Cells, _usual: object) -> Panel:
    """Return cells in blocks and, behind them, the inverse lengths of regions a row earlier."""
    side = len(cells)
    blocks = reference_words(cells.reshape(side * side, -1), FLOATS).array
    inverse = np.zeros(len(blocks) * _FLOAT_COLUMNS, np.float32)
    inverse[side : side * side] = _inverse_lengths(cells)[:-1].ravel()
    return panel_of(np.append(blocks, inverse))


def _compare_cells(query: _Cells, references: Sequence[Panel]) -> Scores:
    scores = np.empty(len(references), np.float32)
    _cell_scores(
        query.words.address, query.inverse, query.count, query.side, addresses(references), scores
    )
    return scores, None


def _see_bytes(query: Descriptor, _least_bits: float, _usual: object) -> _Bytes | None:
    if not query.informative:
        return None
    salient = regions(query.cells)[query.salient]
    words = query_words(quantised(salient, _QUERY_SCALE, _QUERY_SCALE), BYTES)
    return _Bytes(words, len(salient))


def _bytes_of(cells: Cells, _usual: object) -> Panel:
    whole = quantised(regions(cells), _REFERENCE_SCALE, _REFERENCE_SCALE, 0)
    return reference_words(whole, BYTES)


def _compare_bytes(query: _Bytes, references: Sequence[Panel]) -> Scores:
    scores = np.empty(len(references), np.float32)
    blocks = -(-references[0].array.size // (_COLUMNS * BYTE_WORDS))
    _byte_scores(query.words.address, query.count, blocks, addresses(references), scores)
    return scores, None


@compiled
def _cell_scores(query, inverse, count, side, references, scores):  # type: ignore[no-untyped-def]
    """
    Write the scores of a query and each reference, all of them addresses.

    The dot product of two regions is the sum of those of their four cells, over both lengths: a
    quarter of the products. They come in order of the query's cells; sums of two neighbours are
    kept until the row below has come too.
    """
    blocks = -(-side * side // _FLOAT_COLUMNS)
    width = blocks * _FLOAT_COLUMNS
    dots = aligned((_FLOAT_ROWS + 1) * (width + _FLOAT_COLUMNS)).reshape(_FLOAT_ROWS + 1, -1)
    sums = aligned((side + 1) * (side + width + _FLOAT_COLUMNS)).reshape(side + 1, -1)
    for index in range(len(references)):
        lengths = references[index] + width * CELL_WORDS * 4
        total = 0.0
        for tile in range(-(-side * side // _FLOAT_ROWS)):
            dots[0] = dots[_FLOAT_ROWS]
            for block in range(blocks):
                first = block * _FLOAT_COLUMNS
                keep_cell_dots(
                    query + tile * _FLOAT_ROWS * CELL_WORDS * 4,
                    references[index] + first * CELL_WORDS * 4,
                    address(dots) + 4 * (dots.shape[1] + first),
                    4 * dots.shape[1],
                )
            for row in range(_FLOAT_ROWS):
                cell = tile * _FLOAT_ROWS + row - 1
                region = cell - side
                if cell < 0 or cell >= side * side:
                    continue
                factor = inverse[region] if region >= 0 else np.float32(0)
                if factor > 0 or inverse[cell] > 0:
                    left = address(dots) + 4 * row * dots.shape[1]
                    above = (cell + 1) % (side + 1) * sums.shape[1]
                    kept = cell % (side + 1) * sums.shape[1] + side
                    best = best_block(
                        left,
                        left + 4 * (dots.shape[1] + 1),
                        address(sums) + 4 * above,
                        lengths,
                        address(sums) + 4 * kept,
                        2 * blocks,
                    )
                    total += best * factor
        scores[index] = min(total / count, 1.0)


@compiled
def _byte_scores(query, count, blocks, references, scores):  # type: ignore[no-untyped-def]
    """Write the scores of a query and each reference, all of them addresses."""
    best = np.empty((_ROWS, _LANES), np.int32)
    for index in range(len(references)):
        total = 0
        for first in range(0, count, _ROWS):
            best[:] = 0
            for block in range(blocks):
                keep_maxima(
                    query + first * BYTE_WORDS * 4,
                    references[index] + block * _COLUMNS * BYTE_WORDS * 4,
                    address(best),
                )
            for row in range(min(_ROWS, count - first)):
                total += maximum(address(best) + row * _LANES * 4)
        scores[index] = min(total / (count * _QUERY_SCALE * _REFERENCE_SCALE), 1.0)


def float32() -> PairScore:
    """Return the pair score by float32 products; scores are those of the definition."""
    return PairScore(f'float32 {FLOATS.name}', True, _see_cells, _cells_of, _compare_cells)


def int8() -> PairScore:
    """Return the pair score by 8-bit products; scores are within 0.001 of the definition's."""
    return PairScore(f'int8 {BYTES.name}', False, _see_bytes, _bytes_of, _compare_bytes)
