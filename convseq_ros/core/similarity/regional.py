# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Regional convolutional matching: the paper's pair score (III-D)."""

from collections.abc import Iterable, Sequence
from functools import cache, lru_cache
from typing import Any

from convseq_ros.core.encoding.unit import unit
from convseq_ros.core.similarity.kernels.instructions import float_tile
from convseq_ros.core.similarity.pair_score import PairScore, Scores
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

_KEPT = 32


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
    return _compare(regions(query.cells)[query.salient], list(references))[0]


def similarity(query: Descriptor, other: Descriptor) -> float:
    """Return the pair score of an informative query and another descriptor, in [0, 1]."""
    seen, prepared = _seen(_Same(query)), _prepared(_Same(other))
    return float(_kernel().compare(seen, [prepared])[0][0])


class _Same:
    """A descriptor that equals only itself, so that what is made of it can be kept."""

    __slots__ = ('descriptor',)

    def __init__(self, descriptor: Descriptor) -> None:
        self.descriptor = descriptor

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.descriptor is other.descriptor

    def __hash__(self) -> int:
        return id(self.descriptor)


@lru_cache(1)
def _seen(query: _Same) -> Any:
    return _kernel().see(query.descriptor, 0.0, None)


@lru_cache(_KEPT)
def _prepared(other: _Same) -> Any:
    return _kernel().prepare(other.descriptor.cells, None)


@cache
def _kernel() -> PairScore:
    """Return the fastest kernel whose scores are those of the definition."""
    if not float_tile():
        return REGIONAL
    from convseq_ros.core.similarity.kernels.regional import float32

    return float32()


def _see(query: Descriptor, _least_bits: float, _usual: object) -> npt.NDArray[np.float32] | None:
    return regions(query.cells)[query.salient] if query.informative else None


def _compare(
    salient: npt.NDArray[np.float32], references: Sequence[npt.NDArray[np.float32]]
) -> Scores:
    scores = [min(float((salient @ one.T).max(axis=1).mean()), 1.0) for one in references]
    return np.array(scores, np.float32), None


def _prepare(cells: npt.NDArray[np.float32], _usual: object) -> npt.NDArray[np.float32]:
    return regions(cells)


REGIONAL = PairScore('numpy', True, _see, _prepare, _compare)
