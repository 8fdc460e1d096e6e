# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which references are worth scoring: a shortlist by pooled descriptors along diagonals."""

from collections.abc import Sequence

from convseq_ros.core.matching.coherent import projected_regions
from convseq_ros.core.matching.unit import unit
from convseq_ros.core.reference_map import ReferenceMap
from convseq_ros.core.sequence import Row, sequence_scores
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

_GRID = 8
_PRIOR_FRAMES = 5


def pooled(cells: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """
    Return the mean of an image's projected regions over a grid of at most 8 x 8.

    Parameters
    ----------
    cells : ndarray of float32, shape (S, S, 8)
        Cell histograms.

    Returns
    -------
    ndarray of float32, shape (2048,), fewer for images below 160 px
        Not normalised.

    """
    regions = projected_regions(cells)
    side = int(len(regions) ** 0.5)
    image = regions.reshape(side, side, -1)
    grid = min(_GRID, side)
    starts = np.arange(grid) * side // grid
    counts = np.diff(np.append(starts, side))
    sums = np.add.reduceat(np.add.reduceat(image, starts, axis=0), starts, axis=1)
    return (sums / (counts[:, None, None] * counts[None, :, None])).ravel().astype(np.float32)


class Shortlist:
    """
    Finds the references where a sequence may end, at the cost of one product a reference.

    The map's mean is taken from its references, and the mean of the query's own past from the
    query, so that what night or season does to every image counts for nothing.

    Parameters
    ----------
    reference_map : ReferenceMap
        The references.
    length : int
        How many ends are listed.
    rival_distance : int
        A third of them lie no nearer to each other than this, so that rivals are among them.

    """

    def __init__(self, reference_map: ReferenceMap, length: int, rival_distance: int) -> None:
        references = np.array(
            [pooled(reference_map.cells(index)) for index in range(len(reference_map))]
        )
        self._mean = references.mean(axis=0)
        self._references = unit(references - self._mean)
        self._length = length
        self._rival_distance = rival_distance
        self._sum = _PRIOR_FRAMES * self._mean
        self._frames = _PRIOR_FRAMES

    def row(self, descriptor: Descriptor) -> Row:
        """Return how alike a query and every reference are at first sight, shape (R,)."""
        query = pooled(descriptor.cells)
        self._sum += query
        self._frames += 1
        return self._references @ unit(query - self._sum / self._frames)

    def ends(self, rows: Sequence[Row | None], slope: float = 1.0) -> npt.NDArray[np.int64]:
        """Return the references, ascending, where the diagonals of the best sequences end."""
        scores = sequence_scores(rows, slope=slope)
        best = np.argsort(-scores, kind='stable')[: self._length - self._length // 3]
        listed = [int(index) for index in best if np.isfinite(scores[index])]
        for _ in range(self._length // 3):
            for index in listed:
                near = max(0, index - self._rival_distance)
                scores[near : index + self._rival_distance + 1] = -np.inf
            index = int(scores.argmax())
            if not np.isfinite(scores[index]):
                break
            listed.append(index)
        return np.array(sorted(set(listed)), np.int64)
