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
from convseq_ros.core.encoding.regions import Cells, projected_regions, REGION, Regions, thinned
from convseq_ros.core.map.place import Packed
from convseq_ros.core.similarity.global_similarity import Blocks, Wide, widened
from convseq_ros.core.similarity.pair_score import PairScore, Scores, Shown
from convseq_ros.core.types import Descriptor
import cv2
import numpy as np
import numpy.typing as npt


@constants
class COHERENT:
    """Of the votes for a shift; chosen on real image pairs (docs/MATCHING.md)."""

    sigma_cells: float = 1.5  # of the Gaussian within which votes are counted together
    reach_cells: int = 6  # where the Gaussian ends, four sigmas from its middle
    # Rough scores are those of every second region of both images, a sixteenth of the work.
    rough_step: int = 2
    rough_sigma: float = 1.0  # second regions


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
    wide: Wide | None  # its blocks; None without a background


def extract(
    query: Descriptor, least_bits: float, regions: Regions | None = None, step: int = 1
) -> CoherentQuery | None:
    """
    Return what is compared of a query; None if no region of it is salient.

    A region is, if the mean entropy over its 3 x 3 cells is at least so many bits. `regions` are
    all regions of the query, (N, 32); its `projected_regions` by default. Of rows and columns of
    regions, one of each `step` is taken.
    """
    entropy = cv2.boxFilter(query.cell_entropy, -1, (REGION.span, REGION.span))[1:-1, 1:-1]
    index = np.flatnonzero(entropy[::step, ::step] >= least_bits)
    if not index.size or not query.cells.any():
        return None
    regions = projected_regions(query.cells) if regions is None else regions
    return CoherentQuery(thinned(regions, step)[index], index, -(-len(entropy) // step))


def coherent_pair(
    name: str,
    exact: bool,
    regions: tuple[
        Callable[[Cells], Cells],
        Callable[[Cells, int], Regions],
        Callable[[Regions, Regions | None], Shown],
    ],
    pack_query: Callable[[CoherentQuery], Any],
    references: tuple[Callable[[Regions, Blocks | None], Any], Callable[[Any], Regions]],
    compare: Callable[
        [Any, Wide | None, Sequence[Any], int], tuple[Scores, npt.NDArray[np.float32] | None]
    ],
    prepare_packed: Callable[[Sequence[Packed], bool, Regions | None, int], list[Any]]
    | None = None,
) -> PairScore:
    """
    Return the pair score of a kernel: `coherent_score`, less where whole images differ.

    If there is a background, up to half of the score is lost as the global similarity falls.
    `regions` are the kernel's `normalized`, `projected_regions` and `less_background`; `compare`
    computes `coherent_score` of a query and some references, and their `global_similarity`, as
    `pack_query` and the first of `references` lay them out; the second gives regions back. Rough
    scores are those of every second region, whatever whole images show.
    """
    _, project, subtract = regions
    pack_reference, regions_of = references

    def of_step(step: int, rough: PairScore | None = None) -> PairScore:
        def extracted(query: Descriptor, least_bits: float, shown: Shown | None) -> _Query | None:
            own, blocks = shown or (project(query.cells, 1), None)
            found = extract(query, least_bits, own, step)
            if found is None:
                return None
            wide = None if blocks is None or step > 1 else widened(blocks, found.side)
            return _Query(found, pack_query(found), wide)

        def prepare(cells: Cells, background: Regions | None) -> Any:
            behind = None if background is None else thinned(background, step)
            shown, blocks = subtract(project(cells, step), behind)
            return pack_reference(shown, blocks if step == 1 else None)

        def score(query: _Query, references: Sequence[Any]) -> Scores:
            (shares, shifts), alike = compare(query.packed, query.wide, references, step)
            return (shares if alike is None else shares * (0.5 + 0.5 * alike)), shifts

        def prepare_all(
            packed: Sequence[Packed], normalizes: bool, background: Regions | None
        ) -> list[Any]:
            assert prepare_packed
            behind = None if background is None else thinned(background, step)
            return prepare_packed(packed, normalizes, behind, step)

        made = prepare_all if prepare_packed else None
        return PairScore(name, exact, extracted, prepare, score, *regions, made, regions_of, rough)

    return of_step(1, of_step(COHERENT.rough_step))
