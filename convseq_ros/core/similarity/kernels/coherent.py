# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coherent pair scores, compiled: coherent.c."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

from convseq_ros.core.compiled import array, kernel, library, SIZE
from convseq_ros.core.encoding.kernels import project
from convseq_ros.core.similarity.coherent import COHERENT, coherent_pair, CoherentQuery
from convseq_ros.core.similarity.global_similarity import Wide
from convseq_ros.core.similarity.kernels.numpy_coherent import WINDOWS
from convseq_ros.core.similarity.kernels.panel import (
    COLUMNS,
    Packed,
    query_bytes,
    query_floats,
    rounded_up,
    ROWS,
    tiled,
)
from convseq_ros.core.similarity.kernels.references import (
    alike,
    pack,
    pack_all,
    Reference,
    regions_of,
)
from convseq_ros.core.similarity.kernels.regions import less_background, normalized
from convseq_ros.core.similarity.pair_score import PairScore, Scores
import numpy as np
import numpy.typing as npt

_SCALE = 160.0  # of a region's numbers as bytes; hardly any of a unit vector is clipped
_MARGIN = 8  # of a grid of votes, as in coherent.c

_WORDS = array('i4')
_of_pairs = (
    _WORDS, _WORDS, SIZE, SIZE, SIZE, _WORDS, _WORDS, array('f8'), array('u8'), SIZE, array('f8'),
)  # fmt: skip
_compare_bytes = kernel('compare', array('i1'), *_of_pairs)
_compare_floats = kernel('compare', array('f4'), *_of_pairs)


@dataclass(frozen=True, slots=True)
class _Query:
    """What is compared of a query, and its regions as they are compared."""

    count: int  # G
    side: int  # regions in a row of the image
    start: npt.NDArray[np.int32]  # where they lie in a grid of votes, up to full tiles
    packed: Packed


def _float_query(query: CoherentQuery) -> _Query:
    return _laid_out(query, query_floats(query.regions))


def _byte_query(query: CoherentQuery) -> _Query:
    return _laid_out(query, query_bytes(query.regions, _SCALE))


def _laid_out(query: CoherentQuery, packed: Packed) -> _Query:
    start = _grid(query.side)[1][tiled(query.index, ROWS)]
    return _Query(len(query.index), query.side, start, packed)


@cache
def _grid(side: int) -> tuple[int, npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the width of a grid of votes, where regions lie in it, and labels for all."""
    width, rows = rounded_up(2 * side - 1, _MARGIN) + 2 * _MARGIN, np.arange(side, dtype=np.int32)
    end = tiled((rows[:, None] * np.int32(width) + rows).ravel(), COLUMNS)
    return width, end, np.arange(len(end) + side**2 + ROWS, dtype=np.int32)


def _compared(
    query: _Query, wide: Wide | None, others: Sequence[Reference], step: int
) -> tuple[Scores, npt.NDArray[np.float32] | None]:
    compare = _compare_floats if query.packed[1] is None else _compare_bytes
    found, where = np.empty((len(others), 3)), np.array([one.address for one in others], np.uint64)
    own = *query.packed, query.start, query.count, query.side
    half = WINDOWS[step][COHERENT.reach_cells :]
    compare(*own, *_grid(query.side), half, where, len(others), found)
    scores = found[:, 0].astype(np.float32), found[:, 1:]
    return scores, None if wide is None else alike(wide, others, where)


def _pair(name: str, scale: float, pack_query: Callable[[CoherentQuery], _Query]) -> PairScore:
    """Return the pair score by bytes, if there is a scale, or by floats."""
    return coherent_pair(
        f'{name} {library().variant}',
        not scale,
        (normalized, project, less_background),
        pack_query,
        (partial(pack, scale=scale), partial(regions_of, scale=scale)),
        _compared,
        partial(pack_all, scale=scale),
    )


def float32() -> PairScore:
    """Return the pair score by float32 products; scores are those of the definition."""
    return _pair('float32', 0.0, _float_query)


def int8() -> PairScore:
    """Return the pair score by 8-bit products; scores are within 0.01 of the definition's."""
    return _pair('int8', _SCALE, _byte_query)
