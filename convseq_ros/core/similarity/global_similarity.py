# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The global similarity of two images, one of which may have moved to the side."""

from math import isqrt

from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.regions import Regions
from convseq_ros.core.types import Doubles, Floats
import numpy as np
import numpy.typing as npt

Blocks = Floats  # of B x B numbers of 32, in one vector (L,)
Wide = Floats  # (B, B + 2 M, 32), a query's, with room to move it by M


@constants
class GLOBAL_SIMILARITY:
    """Chosen on real and darkened image pairs (docs/MATCHING.md)."""

    block: int = 3  # regions in a row that are summed up
    most_shift: int = 4  # blocks to either side
    unit: float = (
        2.0**17
    )  # of a region's numbers; products of whole numbers are exact, in any order


def region_blocks(regions: Regions) -> Blocks:
    """Return the sums of 3 x 3 neighbouring regions (N, 32), as `rounded` does."""
    side = isqrt(len(regions))
    starts = np.arange(0, side, GLOBAL_SIMILARITY.block)
    image = regions.reshape(side, side, -1)
    return rounded(np.add.reduceat(np.add.reduceat(image, starts, 0), starts, 1))


def rounded(blocks: Floats) -> Blocks:
    """Return blocks of any shape in one vector, in whole numbers of which 2 ** 17 are one."""
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


def lengths(vectors: npt.NDArray[np.floating]) -> Doubles:
    """Return the lengths of vectors (..., L) of whole numbers."""
    return np.sqrt(np.einsum('...i,...i->...', vectors, vectors, dtype=np.float64))
