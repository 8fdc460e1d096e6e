# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coarse scores of large maps: an index names the likely references, the others are all alike."""

from typing import Any

from convseq_ros.core.constants import constants
from convseq_ros.core.sequence.centred import Centred, Usual
from convseq_ros.core.similarity.kernels.numpy_halves import Floats, Halves, products
from convseq_ros.core.types import Indices, Row
from convseq_ros.errors import ConfigError
from convseq_ros.installing import pip_install
import numpy as np


@constants
class INDEX:
    """Of the index; by recall and time at a million drawn places (docs/FLEET.md)."""

    listed: int = 20_000  # references a frame that have a score of their own
    numbers: int = 2  # of a descriptor for each code, which has 4 bits
    trained: int = 16_384  # references, evenly spread, that choose what the codes mean
    meanings: int = 16  # of a code
    added: int = 16_384  # references at once; 33 MB


class Indexed(Centred):
    """
    References whose codes of 4 bits are looked at first, by faiss: 63 bytes each.

    The best by their codes get their exact scores. All others get one score, which leaves the mean
    of a row what it is; so who was overlooked in a frame is found by the others of its sequence.
    References that come later are not known; maps that grow have no index. ConfigError if faiss is
    not installed.
    """

    def __init__(self, usual: Usual, references: Halves, starts: Indices) -> None:
        super().__init__(usual, references, starts)
        faiss = _faiss(len(references))
        self._spread, count = np.sqrt(1 / self._weights), len(references)
        codes = -(-references.shape[1] // INDEX.numbers)
        self._padding = codes * INDEX.numbers - references.shape[1]
        self._index: Any = faiss.IndexPQFastScan(
            codes * INDEX.numbers, codes, 4, faiss.METRIC_INNER_PRODUCT
        )
        self._index.pq.cp.min_points_per_centroid = 1  # or it prints a warning
        some = np.linspace(0, count - 1, min(INDEX.trained, count)).astype(np.int64)
        self._index.train(self._units(references, starts, some))
        total = np.zeros(references.shape[1] + self._padding)
        for start in range(0, count, INDEX.added):
            more = np.arange(start, min(start + INDEX.added, count))
            units = self._units(references, starts, more)
            self._index.add(units)
            total += units.sum(axis=0, dtype=np.float64)
        self._total = total[: references.shape[1]]

    def row(self, references: Halves, starts: Indices, direction: Floats) -> Row:
        count = self._index.ntotal
        listed = min(INDEX.listed, count)
        query = np.pad(direction * self._spread, (0, self._padding)).astype(np.float32)
        best = np.sort(self._index.search(query[None], listed)[1][0])
        usual = (self._means.astype(np.float64) @ direction).astype(np.float32)
        scores = products(references[best], direction) - usual[_sessions(starts, best)]
        scores *= self._nearness.view[best]
        others = self._total @ (direction * self._spread) - scores.sum(dtype=np.float64)
        row = np.full(count, others / max(1, count - listed), np.float32)
        row[best] = scores
        return row

    def _units(self, references: Halves, starts: Indices, some: Indices) -> Floats:
        """Return what a direction's products with are the cosines (n,) of some references."""
        away = references[some].astype(np.float32) - self._means[_sessions(starts, some)]
        away *= self._nearness.view[some, None]
        return np.pad((away / self._spread).astype(np.float32), ((0, 0), (0, self._padding)))


def centred(usual: Usual, references: Halves, starts: Indices, index_above: int) -> Centred:
    """Return references, with an index if there are more than so many; 0: never."""
    is_large = index_above and len(references) > max(index_above, INDEX.meanings)
    return (Indexed if is_large else Centred)(usual, references, starts)


def _sessions(starts: Indices, some: Indices) -> Indices:
    return np.searchsorted(starts, some, 'right') - 1


def _faiss(count: int) -> Any:
    try:
        import faiss
    except ImportError:
        raise ConfigError(
            f'a map of {count} places, more than index_above, needs faiss: '
            f'{pip_install("faiss-cpu")}, or set index_above to 0, and every frame takes longer'
        ) from None
    faiss.omp_set_num_threads(1)  # the same codes on any machine
    return faiss
