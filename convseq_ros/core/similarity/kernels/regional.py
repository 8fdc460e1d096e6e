# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's pair scores, compiled: regional.c."""

from collections.abc import Sequence
from dataclasses import dataclass

from convseq_ros.core.compiled import array, DOUBLE, kernel, library, SIZE
from convseq_ros.core.encoding.regions import Cells, paper_regions
from convseq_ros.core.similarity.kernels.panel import (
    addresses,
    Bytes,
    empty_panel,
    Panel,
    query_bytes,
    query_floats,
    reference_bytes,
    reference_floats,
)
from convseq_ros.core.similarity.pair_score import PairScore, Scores
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

# Of a region's numbers as bytes; none is negative, so a reference's begin below zero.
_SCALE, _REFERENCE_SCALE, _ORIGIN = 127.0, 254.0, 127

_of_pairs = array('u8'), SIZE, array('f4')
_score_bytes = kernel('score_bytes', array('i1'), array('i4'), SIZE, SIZE, DOUBLE, *_of_pairs)
_score_cells = kernel('score_cells', array('f4'), array('f4'), SIZE, SIZE, *_of_pairs)


@dataclass(frozen=True, slots=True)
class _Cells:
    """A query's cells, and the inverse lengths of its regions, 0 where not salient, (S * S,)."""

    packed: Panel
    inverse: npt.NDArray[np.float32]
    count: int
    side: int


def _inverse_lengths(cells: Cells) -> npt.NDArray[np.float32]:
    """Return one over the length of each region, in the place of its first cell; 0 elsewhere."""
    squares = np.einsum('rcb,rcb->rc', cells, cells)
    rows = squares[:-1] + squares[1:]
    length = np.sqrt(rows[:, :-1] + rows[:, 1:])
    inverse = np.zeros(cells.shape[:2], np.float32)
    np.divide(1, length, out=inverse[:-1, :-1], where=length > 0)
    return inverse


def _extract_cells(query: Descriptor, _least_bits: float, _shown: object) -> _Cells | None:
    if not query.informative:
        return None
    side = len(query.cells)
    inverse = _inverse_lengths(query.cells)
    salient = query.salient.reshape(side - 1, side - 1)
    inverse[:-1, :-1] *= salient
    packed = query_floats(query.cells.reshape(side * side, -1))
    return _Cells(packed, inverse.ravel(), int(salient.sum()), side)


def _cells_of(cells: Cells, _background: object) -> Panel:
    """Return cells in blocks and, behind them, the inverse lengths of regions a row earlier."""
    side = len(cells)
    blocks = reference_floats(cells.reshape(side * side, -1))
    inverse = np.zeros(blocks.size // cells.shape[2], np.float32)
    inverse[side : side * side] = _inverse_lengths(cells)[:-1].ravel()
    panel = empty_panel(blocks.size + inverse.size, np.float32)
    panel[: blocks.size], panel[blocks.size :] = blocks, inverse
    return panel


def _compare_cells(query: _Cells, references: Sequence[Panel]) -> Scores:
    found, where = np.empty(len(references), np.float32), addresses(references)
    _score_cells(
        query.packed, query.inverse, query.count, query.side, where, len(references), found
    )
    return found, None


def _extract_bytes(
    query: Descriptor, _least_bits: float, _shown: object
) -> tuple[Bytes, int] | None:
    if not query.informative:
        return None
    salient = paper_regions(query.cells)[query.salient]
    return query_bytes(salient, _SCALE, _ORIGIN), len(salient)


def _bytes_of(cells: Cells, _background: object) -> Panel:
    return reference_bytes(paper_regions(cells), _REFERENCE_SCALE, _ORIGIN)


def _compare_bytes(query: tuple[Bytes, int], references: Sequence[Panel]) -> Scores:
    found, where = np.empty(len(references), np.float32), addresses(references)
    packed, count = query
    columns = references[0].size // 32
    _score_bytes(*packed, count, columns, _SCALE * _REFERENCE_SCALE, where, len(references), found)
    return found, None


def float32() -> PairScore:
    """Return the pair score by float32 products; scores are those of the definition."""
    name = f'float32 {library().variant}'
    return PairScore(name, True, _extract_cells, _cells_of, _compare_cells)


def int8() -> PairScore:
    """Return the pair score by 8-bit products; scores are within 0.001 of the definition's."""
    name = f'int8 {library().variant}'
    return PairScore(name, False, _extract_bytes, _bytes_of, _compare_bytes)
