# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Coherent matching (ours): the share of regions that moved together from query to reference.

At the true place, the regions of the query are found in the reference with a common shift. At
other places the shifts scatter, however similar the best counterparts are. So the score depends on
where a counterpart lies, not on its similarity, and survives night, seasons and another viewpoint.
The global similarity compares entire images, one of which may be shifted sideways.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from math import isqrt
from typing import Any

from convseq_ros.core.encoding.regions import Cells, projected_regions, REGION, Regions, thinned
from convseq_ros.core.map.place import Packed, unpack_cells
from convseq_ros.core.types import constants, Descriptor, Doubles, Floats, Indices
import cv2
import numpy as np

Scores = tuple[Floats, Doubles]  # (n,) in [0, 1], and shifts (n, 2), rows and columns in cells
# Scores, shifts, and global similarities (n,) if they are known.
Compared = tuple[Floats, Doubles, Floats | None]
Blocks = Floats  # (L,): B x B blocks of 32 numbers in a vector
# Regions (N, 32) less the background, and their blocks; None without a background.
Foreground = tuple[Regions, Blocks | None]
Wide = Floats  # (B, B + 2 M, 32), a query's blocks, padded so that it can be shifted by M


@constants
class COHERENT:
    """The votes for a shift; tuned by hand on real image pairs, without a record."""

    sigma_cells: float = 1.5  # of the Gaussian that votes are summed with
    reach_cells = round(4 * sigma_cells)  # where the Gaussian ends
    # Rough scores use every second row and column of regions of both images: 1/16 of the work.
    rough_step: int = 2
    rough_sigma: float = 1.0  # the sigma of rough scores, in steps of 2 cells


@constants
class GLOBAL_SIMILARITY:
    """Tuned on 29 sets, by day and darkened (MATCHING.md of commit ad68631c)."""

    block = REGION.span  # side of a block, in regions; they share cells
    most_shift: int = 4  # largest shift to either side, in blocks
    unit = 2.0**17  # scale of numbers: sums of products stay integers below 2 ** 53, so exact


def region_blocks(regions: Regions) -> Blocks:
    """Return the sums of blocks of 3 x 3 regions (N, 32), as integers in units of 2 ** -17."""
    side = isqrt(len(regions))
    starts = np.arange(0, side, GLOBAL_SIMILARITY.block)
    image = regions.reshape(side, side, -1)
    blocks = np.add.reduceat(np.add.reduceat(image, starts, 0), starts, 1)
    return np.rint(blocks.ravel() * np.float32(GLOBAL_SIMILARITY.unit))


def widened(blocks: Blocks, side: int) -> Wide:
    """Return a query's blocks, padded by up to 4 on each side; `side` is regions in a row."""
    count = -(-side // GLOBAL_SIMILARITY.block)
    most = min(GLOBAL_SIMILARITY.most_shift, count - 1)
    wide = np.zeros((count, count + 2 * most, blocks.size // count**2), np.float32)
    wide[:, most : most + count] = blocks.reshape(count, count, -1)
    return wide


def global_similarity(query: Wide, references: Doubles) -> Floats:
    """Return the best cosines (n,), in [0, 1], of a shifted query with references (n, L)."""
    count, width = query.shape[:2]
    moved = [query[:, first : first + count].ravel() for first in range(width - count + 1)]
    best = (np.array(moved, np.float64) @ references.T).max(axis=0)
    return from_products(best, query, lengths(references))


def from_products(best: Doubles, query: Wide, others: Doubles) -> Floats:
    """Return cosines in [0, 1] from products with references, whose lengths are `others`."""
    both = lengths(query.ravel()) * others
    return np.clip(best / np.where(both > 0, both, 1), 0, 1).astype(np.float32)


def lengths(vectors: Floats | Doubles) -> Doubles:
    """Return the lengths of vectors (..., L) of integers."""
    return np.sqrt(np.einsum('...i,...i->...', vectors, vectors, dtype=np.float64))


@dataclass(frozen=True, slots=True)
class CoherentQuery:
    """The G salient regions of a query."""

    regions: Regions  # (G, 32), from `projected_regions`
    index: Indices  # (G,), their positions, row by row
    side: int  # number of regions in a row of the image


def extract(
    query: Descriptor, least_bits: float, regions: Regions | None = None, step: int = 1
) -> CoherentQuery | None:
    """
    Return the salient regions of a query; None if there are none.

    A region is salient if its 3 x 3 cells have a mean of at least `least_bits`. `regions` are all
    regions (N, 32), by default projected; every `step`-th row and column of them is used.
    """
    entropy = cv2.boxFilter(query.cell_entropy, -1, (REGION.span, REGION.span))[1:-1, 1:-1]
    index = np.flatnonzero(entropy[::step, ::step] >= least_bits)
    if not index.size or not query.cells.any():
        return None
    regions = projected_regions(query.cells) if regions is None else regions
    return CoherentQuery(thinned(regions, step)[index], index, -(-len(entropy) // step))


class CoherentPair:
    """
    A kernel: its features of queries and references, and their scores.

    A score is the `coherent_score`; with a background, it is multiplied by
    (1 + global similarity) / 2. Rough scores use every second row and column of regions, without
    global similarity. Subclasses lay out queries and references, and compare them.
    """

    name: str
    # The steps from cells to normalised cells, to regions, and to regions less a background.
    normalize: Callable[[Cells], Cells]
    project: Callable[..., Regions]
    subtract: Callable[[Regions, Regions | None], Foreground]
    # The layouts of a query and of a reference (regions (N, 32) and their blocks); then their
    # scores: for each reference the `coherent_score`, its shift and the global similarity.
    laid_out: Callable[[CoherentQuery], Any]
    packed: Callable[[Regions, Blocks | None], Any]
    scores: Callable[[Any, Wide | None, Sequence[Any]], Compared]
    # From the features of a reference to its regions (N, 32), rounded to bytes.
    regions_of: Callable[[Any], Regions]
    step = 1  # every `step`-th row and column of regions is compared

    def __init__(self) -> None:
        self.rough = copy(self)  # the kernel of rough scores, for 1/16 of the work
        self.rough.step = COHERENT.rough_step

    def extract(
        self, query: Descriptor, least_bits: float, regions: Foreground | None = None
    ) -> Any:
        """
        Return the features of a query; None if it is not informative.

        A region is salient from `least_bits` of entropy on. `regions` are all of its regions, if
        computed.
        """
        whole, blocks = regions or (self.project(query.cells, 1), None)
        if (salient := extract(query, least_bits, whole, self.step)) is None:
            return None
        wide = None if blocks is None or self.step > 1 else widened(blocks, salient.side)
        return self.laid_out(salient), wide

    def prepare(self, cells: Cells, background: Regions | None) -> Any:
        """Return the features of a reference, given its map's background."""
        behind = None if background is None else thinned(background, self.step)
        regions, blocks = self.subtract(self.project(cells, self.step), behind)
        return self.packed(regions, blocks if self.step == 1 else None)

    def prepare_packed(self, packed: Sequence[Packed], background: Regions | None) -> list[Any]:
        """Return the features of references from their packed cells; None for blank ones."""
        every = map(unpack_cells, packed)
        return [self.prepare(self.normalize(it), background) if it.any() else None for it in every]

    def compare(self, query: Any, references: Sequence[Any]) -> Scores:
        """Return the scores and shifts of a query and n references."""
        packed, wide = query
        shares, shifts, similar = self.scores(packed, wide, references)
        return (shares if similar is None else shares * (0.5 + 0.5 * similar)), shifts
