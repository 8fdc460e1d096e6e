# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pair score of coherent matching: shares of regions, less where whole images differ."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from convseq_ros.core.encoding.regions import Cells, projected_regions, Regions
from convseq_ros.core.similarity.background import subtracted
from convseq_ros.core.similarity.cell_normalization import normalized
from convseq_ros.core.similarity.coherent import (
    coherent_score,
    CoherentQuery,
    extract,
    inlier_regions,
)
from convseq_ros.core.similarity.global_similarity import (
    Blocks,
    global_similarity,
    lateral_shifts,
    region_blocks,
)
from convseq_ros.core.similarity.pair_score import PairScore, Scores, ShowRegions
from convseq_ros.core.types import Descriptor, Shift
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class _Query:
    """What is compared of a query, and its lateral shifts if a background is known."""

    regions: CoherentQuery
    packed: Any
    shifted: npt.NDArray[np.float64] | None


@dataclass(frozen=True, slots=True)
class _Reference:
    """What is compared of a reference, and its blocks if a background is known."""

    packed: Any
    blocks: Blocks | None


def coherent_pair(
    name: str,
    exact: bool,
    normalize: Callable[[Cells], Cells],
    regions: ShowRegions,
    pack_query: Callable[[CoherentQuery], Any],
    pack_reference: Callable[[Regions], Any],
    compare: Callable[[Any, Sequence[Any]], Scores],
) -> PairScore:
    """
    Return the pair score that a kernel computes.

    Without a background its scores are those of `coherent_score`. With one, it is subtracted from
    regions, and up to half of the score is lost as the global similarity falls.

    `normalize` and `regions` compute `normalized` and `shown_regions`; `pack_query` and
    `pack_reference` lead to what the kernel compares; `compare` computes `coherent_score` of a
    query and some references.
    """

    def extracted(
        query: Descriptor, least_bits: float, background: Regions | None
    ) -> _Query | None:
        shown, blocks = regions(query.cells, background)
        found = extract(query, least_bits, shown)
        if found is None:
            return None
        shifted = None if blocks is None else lateral_shifts(blocks, found.side)
        return _Query(found, pack_query(found), shifted)

    def prepare(cells: Cells, background: Regions | None) -> _Reference:
        shown, blocks = regions(cells, background)
        return _Reference(pack_reference(shown), blocks)

    def score(query: _Query, references: Sequence[_Reference]) -> Scores:
        shares, shifts = compare(query.packed, [one.packed for one in references])
        blocks = [one.blocks for one in references]
        if query.shifted is None or any(one is None for one in blocks):
            return shares, shifts
        alike = global_similarity(query.shifted, np.array(blocks, np.float64))
        return shares * (0.5 + 0.5 * alike), shifts

    def inliers(query: _Query, reference: Regions, shift: Shift) -> npt.NDArray[np.float64]:
        return inlier_regions(query.regions, reference, shift)

    return PairScore(name, exact, extracted, prepare, score, regions, normalize, inliers)


def shown_regions(cells: Cells, background: Regions | None) -> tuple[Regions, Blocks | None]:
    """Return the regions of an image that are compared, and its blocks if there is background."""
    regions = subtracted(projected_regions(cells), background)
    return regions, None if background is None else region_blocks(regions)


def _same(what: Any) -> Any:
    return what


def _compare(query: CoherentQuery, references: Sequence[Regions]) -> Scores:
    scores, shifts = zip(*(coherent_score(query, one) for one in references), strict=True)
    return np.array(scores, np.float32), np.array(shifts)


COHERENT_PAIR = coherent_pair('numpy', True, normalized, shown_regions, _same, _same, _compare)
