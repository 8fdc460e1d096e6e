# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Coherent matching, ours: the share of regions that moved together from query to reference.

At the true place the regions of the query are found again with one common shift; elsewhere,
however similar the best counterparts are, their shifts scatter. So where each counterpart lies is
asked, not how similar it is, which survives night, seasons and another viewpoint.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.regions import Cells, projected_regions, REGION, Regions
from convseq_ros.core.similarity.global_similarity import Blocks, global_similarity, lateral_shifts
from convseq_ros.core.similarity.pair_score import PairScore, Scores, ShowRegions
from convseq_ros.core.types import Descriptor
import cv2
import numpy as np
import numpy.typing as npt


@constants
class COHERENT:
    """Of the votes for a shift; chosen on real image pairs (docs/MATCHING.md)."""

    sigma_cells: float = 1.5  # of the Gaussian within which votes are counted together
    reach_cells: int = 6  # where the Gaussian ends, four sigmas from its middle


@dataclass(frozen=True, slots=True)
class CoherentQuery:
    """What is compared of a query: its G salient regions."""

    regions: Regions  # (G, 32), from `projected_regions`
    index: npt.NDArray[np.int64]  # (G,), where they lie, row by row
    side: int  # regions in a row of the image


@dataclass(frozen=True, slots=True)
class _Query:
    regions: CoherentQuery
    packed: Any  # what the kernel compares
    shifted: npt.NDArray[np.float64] | None  # lateral shifts, if a background is known


def extract(
    query: Descriptor, least_bits: float, regions: Regions | None = None
) -> CoherentQuery | None:
    """
    Return what is compared of a query; None if no region of it is salient.

    A region is, if the mean entropy over its 3 x 3 cells is at least so many bits. `regions` are
    all regions of the query, (N, 32); its `projected_regions` by default.
    """
    entropy = cv2.boxFilter(query.cell_entropy, -1, (REGION.span, REGION.span))[1:-1, 1:-1]
    index = np.flatnonzero(entropy >= least_bits)
    if not index.size or not query.cells.any():
        return None
    regions = projected_regions(query.cells) if regions is None else regions
    return CoherentQuery(regions[index], index, len(entropy))


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
    Return the pair score of a kernel: `coherent_score`, less where whole images differ.

    If there is a background, up to half of the score is lost as the global similarity falls.
    `normalize`, `regions` and `compare` compute `normalized`, `shown_regions` and `coherent_score`
    of a query and some references, as `pack_query` and `pack_reference` lay them out.
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

    def prepare(cells: Cells, background: Regions | None) -> tuple[Any, Blocks | None]:
        shown, blocks = regions(cells, background)
        return pack_reference(shown), blocks

    def score(query: _Query, references: Sequence[tuple[Any, Blocks | None]]) -> Scores:
        packed, blocks = zip(*references, strict=True)
        shares, shifts = compare(query.packed, packed)
        if query.shifted is None or any(one is None for one in blocks):
            return shares, shifts
        alike = global_similarity(query.shifted, np.array(blocks, np.float64))
        return shares * (0.5 + 0.5 * alike), shifts

    return PairScore(name, exact, extracted, prepare, score, regions, normalize)
