# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's pair score, compiled: regional.c."""

from collections.abc import Sequence

from convseq_ros.core.compiled import Array, DOUBLE, kernel, library, SIZE
from convseq_ros.core.encoding.regions import Cells, paper_regions, REGION
from convseq_ros.core.similarity.kernels.panels import (
    addresses_of,
    Panel,
    PAPER_ORIGIN,
    Query,
    query_panel,
    reference_panel,
)
from convseq_ros.core.similarity.pair_score import PairScore, Scores, spread, SURE
from convseq_ros.core.types import Descriptor
import numpy as np

# Scales of the paper's regions as bytes. Their numbers are not negative, so a reference's bytes
# start at -127. Dot products are at most 127 x 254, rounding included, and fit in 16 bits. Of 13
# pairs of scales these err least, .0012 at most, on real images with noise at 3 % of the light.
_SCALES = 124.0, 251.0
_of_regional = (
    Array('i4'), SIZE, SIZE, DOUBLE, DOUBLE, DOUBLE, SIZE, Array('u8'), SIZE, Array('f4'),
)  # fmt: skip
# For bytes, and for floats.
_SCORE = [kernel('score', Array(each), *_of_regional) for each in ('i1', 'f4')]


class CompiledRegional(PairScore):
    """The kernel `float32`, exact to 1e-6, or `int8`, to 0.0015."""

    def __init__(self, name: str) -> None:
        self.name, self.exact = f'{name} {library().variant}', name == 'float32'
        self._scale, self._of_references = (0.0, 0.0) if self.exact else _SCALES

    def extract(
        self, query: Descriptor, _least_bits: float, _regions: object
    ) -> tuple[Query, int] | None:
        if not query.informative:
            return None
        salient = spread(paper_regions(query.cells)[query.salient])
        return query_panel(salient, self._scale, PAPER_ORIGIN), len(salient)

    def prepare(self, cells: Cells, _background: object) -> Panel:
        return reference_panel(paper_regions(cells), self._of_references, PAPER_ORIGIN)

    def compare(
        self, query: tuple[Query, int], references: Sequence[Panel], limit: float | None = None
    ) -> Scores:
        scores, where = np.empty(len(references), np.float32), addresses_of(references)
        (packed, count), columns = query, references[0].size // REGION.numbers
        scale = self._scale * self._of_references or 1.0
        until = (0.0, 0.0, 0) if limit is None else (limit, SURE.errors, SURE.regions)
        _SCORE[self.exact](*packed, count, columns, scale, *until, where, len(references), scores)
        return scores, None
