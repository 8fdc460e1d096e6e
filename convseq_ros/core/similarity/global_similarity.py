# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How alike two images are as wholes, where one may have moved to the side."""

from math import isqrt

from convseq_ros.core.encoding.unit import unit
import numpy as np
import numpy.typing as npt

BLOCK = 3
_MOST = 4
_LENGTH = np.float32(2**24)

Whole = npt.NDArray[np.float32]


def whole(regions: npt.NDArray[np.float32]) -> Whole:
    """
    Return the sums of 3 x 3 neighbouring regions in one vector, (L,).

    It is 2 ** 24 long and of whole numbers, so that products of two are exact in any order.
    """
    side = isqrt(len(regions))
    starts = np.arange(0, side, BLOCK)
    image = regions.reshape(side, side, -1)
    return rounded(np.add.reduceat(np.add.reduceat(image, starts, 0), starts, 1))


def rounded(blocks: npt.NDArray[np.float32]) -> Whole:
    """Return blocks of any shape in one vector, as `whole` does."""
    return np.rint(_LENGTH * unit(blocks.ravel()))


def moved(image: Whole, side: int) -> npt.NDArray[np.float64]:
    """
    Return an image moved by up to 4 blocks to each side, (9, L).

    Parameters
    ----------
    image : ndarray of float32, shape (L,)
        From `whole`.
    side : int
        Regions in a row of the image.

    """
    count = -(-side // BLOCK)
    blocks = image.reshape(count, count, -1)
    most = min(_MOST, count - 1)
    found = np.zeros((2 * most + 1, *blocks.shape))
    for one, shift in zip(found, range(-most, most + 1), strict=True):
        one[:, _overlap(shift, count)] = blocks[:, _overlap(-shift, count)]
    return found.reshape(len(found), -1)


def likeness(
    query: npt.NDArray[np.float64], references: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """
    Return the cosines of the best shifts, in [0, 1].

    Parameters
    ----------
    query : ndarray of float64, shape (9, L)
        From `moved`.
    references : ndarray of float64, shape (n, L)
        Rows from `whole`.

    """
    best = (query @ references.T).max(axis=0)
    return np.clip(best / float(_LENGTH) ** 2, 0, 1).astype(np.float32)


def _overlap(shift: int, count: int) -> slice:
    return slice(max(0, shift), count + min(0, shift))
