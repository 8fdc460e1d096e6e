# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Coherent matching, ours: the share of regions that moved together from query to reference.

At the true place the regions of the query are found again with one common shift; elsewhere,
however similar the best counterparts are, their shifts scatter. So where each counterpart lies is
asked, not how similar it is, which survives night, seasons and another viewpoint. The global
similarity is that of whole images, one of which may have moved to the side.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from math import isqrt
from typing import Any

from convseq_ros.core.encoding.regions import Cells, projected_regions, REGION, Regions, thinned
from convseq_ros.core.similarity.pair_score import PairScore, Scores, Shown
from convseq_ros.core.types import constants, Descriptor, Doubles, Floats, Indices
import cv2
import numpy as np

# Scores in [0, 1], (n,), shifts in cells, (n, 2), and global similarities (n,) if they are known.
Compared = tuple[Floats, Doubles, Floats | None]
Blocks = Floats  # of B x B numbers of 32, in one vector (L,)
Wide = Floats  # (B, B + 2 M, 32), a query's, with room to move it by M


@constants
class COHERENT:
    """Of the votes for a shift; chosen on real image pairs (docs/MATCHING.md)."""

    sigma_cells: float = 1.5  # of the Gaussian within which votes are counted together
    reach_cells = round(4 * sigma_cells)  # where the Gaussian ends
    # Rough scores are those of every second region of both images, a sixteenth of the work.
    rough_step: int = 2
    rough_sigma: float = 1.0  # second regions


@constants
class GLOBAL_SIMILARITY:
    """Chosen on real and darkened image pairs (docs/MATCHING.md)."""

    block = REGION.span  # regions in a row that are summed up, which share cells
    most_shift: int = 4  # blocks to either side
    unit = 2.0**17  # of a region's numbers: sums of their products stay whole, below 2 ** 53


def region_blocks(regions: Regions) -> Blocks:
    """Return the sums of 3 x 3 neighbouring regions (N, 32), whole numbers, 2 ** 17 for one."""
    side = isqrt(len(regions))
    starts = np.arange(0, side, GLOBAL_SIMILARITY.block)
    image = regions.reshape(side, side, -1)
    blocks = np.add.reduceat(np.add.reduceat(image, starts, 0), starts, 1)
    return np.rint(blocks.ravel() * np.float32(GLOBAL_SIMILARITY.unit))


def widened(blocks: Blocks, side: int) -> Wide:
    """Return a query's blocks with room for 4 on each side; `side`: regions in a row."""
    count = -(-side // GLOBAL_SIMILARITY.block)
    most = min(GLOBAL_SIMILARITY.most_shift, count - 1)
    wide = np.zeros((count, count + 2 * most, blocks.size // count**2), np.float32)
    wide[:, most : most + count] = blocks.reshape(count, count, -1)
    return wide


def global_similarity(query: Wide, references: Doubles) -> Floats:
    """Return cosines, in [0, 1], of a query, shifted as is best, and references (n, L): (n,)."""
    count, width = query.shape[:2]
    moved = [query[:, first : first + count].ravel() for first in range(width - count + 1)]
    best = (np.array(moved, np.float64) @ references.T).max(axis=0)
    return from_products(best, query, lengths(references))


def from_products(best: Doubles, query: Wide, others: Doubles) -> Floats:
    """Return cosines in [0, 1] from the products with references, and their lengths."""
    both = lengths(query.ravel()) * others
    return np.clip(best / np.where(both > 0, both, 1), 0, 1).astype(np.float32)


def lengths(vectors: Floats | Doubles) -> Doubles:
    """Return the lengths of vectors (..., L) of whole numbers."""
    return np.sqrt(np.einsum('...i,...i->...', vectors, vectors, dtype=np.float64))


@dataclass(frozen=True, slots=True)
class CoherentQuery:
    """What is compared of a query: its G salient regions."""

    regions: Regions  # (G, 32), from `projected_regions`
    index: Indices  # (G,), where they lie, row by row
    side: int  # regions in a row of the image


def extract(
    query: Descriptor, least_bits: float, regions: Regions | None = None, step: int = 1
) -> CoherentQuery | None:
    """
    Return what is compared of a query; None if no region of it is salient.

    A region is, if its 3 x 3 cells have so many bits on average. `regions` are all of them, (N,
    32), by default projected; of their rows and columns, one of each `step` is taken.
    """
    entropy = cv2.boxFilter(query.cell_entropy, -1, (REGION.span, REGION.span))[1:-1, 1:-1]
    index = np.flatnonzero(entropy[::step, ::step] >= least_bits)
    if not index.size or not query.cells.any():
        return None
    regions = projected_regions(query.cells) if regions is None else regions
    return CoherentQuery(thinned(regions, step)[index], index, -(-len(entropy) // step))


class CoherentPair(PairScore):
    """
    The `coherent_score` of a kernel, less where whole images differ.

    If there is a background, up to half of the score is lost as the global similarity falls. Rough
    scores are those of every second region, whatever whole images show. A kernel says how queries
    and references are laid out, and compares them.
    """

    normalize: Callable[[Cells], Cells]
    project: Callable[..., Regions]
    subtract: Callable[[Regions, Regions | None], Shown]
    # How a query, and a reference, by its regions (N, 32) and their blocks, are compared; and of
    # each reference its `coherent_score` and, of a query's blocks, its similarity.
    laid_out: Callable[[CoherentQuery], Any]
    packed: Callable[[Regions, Blocks | None], Any]
    scores: Callable[[Any, Wide | None, Sequence[Any]], Compared]
    step = 1  # of the rows and columns of regions, one of each is compared

    def __init__(self, name: str, exact: bool) -> None:
        self.name, self.exact = name, exact
        self.rough = copy(self)
        self.rough.step = COHERENT.rough_step

    def extract(self, query: Descriptor, least_bits: float, shown: Shown | None) -> Any:
        own, blocks = shown or (self.project(query.cells, 1), None)
        if (found := extract(query, least_bits, own, self.step)) is None:
            return None
        wide = None if blocks is None or self.step > 1 else widened(blocks, found.side)
        return self.laid_out(found), wide

    def thinned(self, background: Regions | None) -> Regions | None:
        """Return of a background what lies behind the regions that are compared."""
        return None if background is None else thinned(background, self.step)

    def prepare(self, cells: Cells, background: Regions | None) -> Any:
        shown, blocks = self.subtract(self.project(cells, self.step), self.thinned(background))
        return self.packed(shown, blocks if self.step == 1 else None)

    def compare(
        self, query: Any, references: Sequence[Any], _limit: float | None = None
    ) -> Scores:
        packed, wide = query
        shares, shifts, alike = self.scores(packed, wide, references)
        return (shares if alike is None else shares * (0.5 + 0.5 * alike)), shifts
