# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Regional convolutional matching: the paper's pair score (III-D)."""

from collections.abc import Iterable

from convseq_ros.core.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt


def regions(cells: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """
    Return the overlapping 2 x 2-cell regions of an image as unit vectors.

    Parameters
    ----------
    cells : ndarray of float32, shape (rows, columns, bins)
        Cell histograms.

    Returns
    -------
    ndarray of float32, shape ((rows - 1) * (columns - 1), 4 * bins)
        Rows of length 1, or 0 for a region without gradient.

    """
    joined = np.concatenate(
        (cells[:-1, :-1], cells[:-1, 1:], cells[1:, :-1], cells[1:, 1:]), axis=2
    ).reshape(-1, 4 * cells.shape[2])
    length = np.linalg.norm(joined, axis=1, keepdims=True)
    return np.divide(joined, length, out=np.zeros_like(joined), where=length > 0)


def pair_scores(
    query: Descriptor, references: Iterable[npt.NDArray[np.float32]]
) -> npt.NDArray[np.float32]:
    """
    Return how similar a query is to each reference.

    For every salient region of the query the most similar region anywhere in the reference counts;
    the score is the mean of these similarities.

    Parameters
    ----------
    query : Descriptor
        With at least one salient region.
    references : iterable of ndarray of float32, shape (N, 4 * bins)
        The `regions` of each reference.

    Returns
    -------
    ndarray of float32, shape (R,)
        In [0, 1]; not symmetric.

    """
    salient = regions(query.cells)[query.salient]
    return np.fromiter(
        ((salient @ reference.T).max(axis=1).mean() for reference in references), np.float32
    ).clip(0.0, 1.0)


def similarity(query: Descriptor, other: Descriptor) -> float:
    """Return the pair score of an informative query and another descriptor, in [0, 1]."""
    return float(pair_scores(query, [regions(other.cells)])[0])


class RegionalMatcher:
    """
    Scores queries against every reference of a map (`pair_scores`).

    Parameters
    ----------
    reference_map : ReferenceMap
        Its regions are held in memory: 123 kB a reference.

    Attributes
    ----------
    informative : ndarray of bool, shape (R,)
        Which references show anything.

    """

    def __init__(self, reference_map: ReferenceMap) -> None:
        cells = [reference_map.cells(index) for index in range(len(reference_map))]
        self._regions = [regions(place) for place in cells]
        self.informative = np.array([place.any() for place in cells], np.bool_)

    def row(self, query: Descriptor) -> npt.NDArray[np.float32]:
        """Return the pair scores of an informative query, float32 of shape (R,)."""
        return pair_scores(query, self._regions)
