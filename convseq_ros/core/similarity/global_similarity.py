# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The global similarity of two images, one of which may have moved to the side."""

from math import isqrt

from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.regions import Regions, unit
import numpy as np
import numpy.typing as npt

Blocks = npt.NDArray[np.float32]


@constants
class GLOBAL_SIMILARITY:
    """Chosen on real and darkened image pairs (docs/MATCHING.md)."""

    block: int = 3  # regions in a row that are summed up
    most_shift: int = 4  # blocks to either side
    length: float = 2.0**24  # of the vector; products of whole numbers are exact in any order


def region_blocks(regions: Regions) -> Blocks:
    """Return the sums of 3 x 3 neighbouring regions (N, 32) in one vector, as `rounded` does."""
    side = isqrt(len(regions))
    starts = np.arange(0, side, GLOBAL_SIMILARITY.block)
    image = regions.reshape(side, side, -1)
    return rounded(np.add.reduceat(np.add.reduceat(image, starts, 0), starts, 1))


def rounded(blocks: npt.NDArray[np.float32]) -> Blocks:
    """Return blocks of any shape in one vector, (L,), of whole numbers and 2 ** 24 long."""
    whole = np.rint(GLOBAL_SIMILARITY.length * unit(blocks.ravel().astype(np.float64)))
    return whole.astype(np.float32)


def lateral_shifts(image: Blocks, side: int) -> npt.NDArray[np.float64]:
    """Return blocks (L,) moved by up to 4 to each side, (9, L); `side`: regions in a row."""
    count = -(-side // GLOBAL_SIMILARITY.block)
    most = min(GLOBAL_SIMILARITY.most_shift, count - 1)
    wide = np.zeros((count, count + 2 * most, image.size // count**2))
    wide[:, most : most + count] = image.reshape(count, count, -1)
    found = [wide[:, first : first + count] for first in range(2 * most, -1, -1)]
    return np.array(found).reshape(len(found), -1)


def global_similarity(
    query: npt.NDArray[np.float64], references: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Return the cosines (n,) in [0, 1] of the best of 9 shifts of a query, of shape (9, L)."""
    return from_products((query @ references.T).max(axis=0))


def from_products(best: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    """Return cosines in [0, 1] from the products of vectors as `rounded` makes them."""
    return np.clip(best / GLOBAL_SIMILARITY.length**2, 0, 1).astype(np.float32)
