# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's pair scores, compiled: regional.c."""

from collections.abc import Sequence

from convseq_ros.core.compiled import array, DOUBLE, kernel, library, SIZE
from convseq_ros.core.encoding.regions import Cells, paper_regions
from convseq_ros.core.similarity.kernels.panel import (
    addresses,
    Packed,
    Panel,
    query_bytes,
    query_floats,
    reference_bytes,
    reference_floats,
)
from convseq_ros.core.similarity.pair_score import PairScore, Scores
from convseq_ros.core.types import Descriptor
import numpy as np

# Of a region's numbers as bytes; none is negative, so a reference's begin below zero. Dot products
# are at most 127 x 254, rounding included, so that 16 bits hold them. Of 13 pairs of scales tried
# these err least, .0012 at most, on real images with noise down to 3 % of the light.
_SCALE, _REFERENCE_SCALE, _ORIGIN = 124.0, 251.0, 127

_of_pairs = array('i4'), SIZE, SIZE, DOUBLE, array('u8'), SIZE, array('f4')
_score_bytes = kernel('score', array('i1'), *_of_pairs)
_score_floats = kernel('score', array('f4'), *_of_pairs)

_Query = tuple[Packed, int]  # and how many of its regions are salient


def _extract_floats(query: Descriptor, _least_bits: float, _shown: object) -> _Query | None:
    if not query.informative:
        return None
    salient = paper_regions(query.cells)[query.salient]
    return query_floats(salient), len(salient)


def _floats_of(cells: Cells, _background: object) -> Panel:
    return reference_floats(paper_regions(cells))


def _extract_bytes(query: Descriptor, _least_bits: float, _shown: object) -> _Query | None:
    if not query.informative:
        return None
    salient = paper_regions(query.cells)[query.salient]
    return query_bytes(salient, _SCALE, _ORIGIN), len(salient)


def _bytes_of(cells: Cells, _background: object) -> Panel:
    return reference_bytes(paper_regions(cells), _REFERENCE_SCALE, _ORIGIN)


def _compare(query: _Query, references: Sequence[Panel]) -> Scores:
    found, where = np.empty(len(references), np.float32), addresses(references)
    packed, count = query
    is_floats, columns = packed[1] is None, references[0].size // 32
    score = _score_floats if is_floats else _score_bytes
    scale = 1.0 if is_floats else _SCALE * _REFERENCE_SCALE
    score(*packed, count, columns, scale, where, len(references), found)
    return found, None


def float32() -> PairScore:
    """Return the pair score by float32 products; scores are those of the definition."""
    return PairScore(f'float32 {library().variant}', True, _extract_floats, _floats_of, _compare)


def int8() -> PairScore:
    """Return the pair score by 8-bit products; scores are within 0.0015 of the definition's."""
    return PairScore(f'int8 {library().variant}', False, _extract_bytes, _bytes_of, _compare)
