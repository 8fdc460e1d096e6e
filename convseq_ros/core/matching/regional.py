# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Regional convolutional matching: the paper's pair score (III-D)."""

from collections.abc import Iterable

from convseq_ros.core.matching.pair_score import PairScore
from convseq_ros.core.matching.unit import unit
from convseq_ros.core.types import Descriptor, Shift
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
    return unit(joined)


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
    return np.array([_compare(salient, reference)[0] for reference in references], np.float32)


def similarity(query: Descriptor, other: Descriptor) -> float:
    """Return the pair score of an informative query and another descriptor, in [0, 1]."""
    return float(pair_scores(query, [regions(other.cells)])[0])


def _see(query: Descriptor, _least_bits: float) -> npt.NDArray[np.float32] | None:
    return regions(query.cells)[query.salient] if query.informative else None


def _compare(
    salient: npt.NDArray[np.float32], reference: npt.NDArray[np.float32]
) -> tuple[float, Shift | None]:
    return min(float((salient @ reference.T).max(axis=1).mean()), 1.0), None


REGIONAL = PairScore(_see, regions, _compare)
