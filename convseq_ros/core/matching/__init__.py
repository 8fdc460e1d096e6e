# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ways to score a pair of images, and the matcher that scores a query in a map with one."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
import os
from typing import Any, TYPE_CHECKING

from convseq_ros.config import MatchingConfig
from convseq_ros.core.entropy import MAX_BITS
from convseq_ros.core.matching.choice import chosen_kernels
from convseq_ros.core.matching.pair_score import PairScore
from convseq_ros.core.matching.regional import similarity
from convseq_ros.core.types import Descriptor, Shift
import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from convseq_ros.core.reference_map import ReferenceMap

_AT_ONCE = 16
_MOST_THREADS = 2
_KEPT_TO_RESCORE = 64


@dataclass(frozen=True, slots=True)
class _Seen:
    """What is compared of a query, by the fast kernel and by an exact one."""

    fast: Any
    exact: Any


class Matcher:
    """
    Scores queries against references of a map, whose regions are rebuilt when they are needed.

    Parameters
    ----------
    reference_map : ReferenceMap
        The references; more may be added to it later.
    matching : MatchingConfig
        How pairs are scored, by which kernel and by how many threads.
    saliency_threshold : float
        Share of 8 bits of entropy that makes a region of a query salient.
    kept : int, optional
        References of which what is compared stays in memory (30 kB each by the 8-bit kernel, about
        120 kB by others); all by default.

    Attributes
    ----------
    kernel : str
        What computes `scores`: numbers and instructions.
    exact : bool
        Whether `scores` are those of the definition, to 1e-6, as `exact_scores` always are.

    Raises
    ------
    ConfigError
        If the machine cannot run the kernel that is asked for.

    """

    def __init__(
        self,
        reference_map: 'ReferenceMap',
        matching: MatchingConfig,
        saliency_threshold: float,
        kept: int | None = None,
    ) -> None:
        self._fast, self._exact = chosen_kernels(matching)
        self._map = reference_map
        self._least_bits = saliency_threshold * MAX_BITS
        self._reference = lru_cache(kept)(partial(self._prepared, self._fast))
        self._exact_reference = self._reference
        if self._exact is not self._fast:
            self._exact_reference = lru_cache(_KEPT_TO_RESCORE)(
                partial(self._prepared, self._exact)
            )
        usable = min(len(os.sched_getaffinity(0)), _MOST_THREADS)
        self._keeps_all = kept is None
        self._helpers = (matching.threads or usable) - 1
        self._pool = ThreadPoolExecutor(self._helpers, 'pairs') if self._helpers else None
        self.kernel = self._fast.name
        self.exact = self._fast.exact

    def see(self, descriptor: Descriptor) -> Any:
        """Return what is compared of a query, or None if it shows nothing."""
        fast = self._fast.see(descriptor, self._least_bits)
        if fast is None:
            return None
        exact = fast if self.exact else self._exact.see(descriptor, self._least_bits)
        return _Seen(fast, exact)

    def scores(self, query: Any, indices: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        """
        Return the pair scores of a query with some references.

        Parameters
        ----------
        query : object
            From `see`.
        indices : ndarray of int64, shape (n,)
            Of the references.

        Returns
        -------
        ndarray of float32, shape (n,)
            In [0, 1]; NaN for a reference that shows nothing.

        """
        return self._scored(self._fast, query.fast, self._reference, indices)

    def exact_scores(
        self, query: Any, indices: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.float32]:
        """Return what `scores` does, by the definition."""
        return self._scored(self._exact, query.exact, self._exact_reference, indices)

    def shift(self, query: Any, index: int) -> Shift | None:
        """Return rows and columns, in cells, from the query to a reference, if known."""
        reference = self._exact_reference(index)
        if reference is None:
            return None
        shifts = self._exact.compare(query.exact, [reference])[1]
        return None if shifts is None else (float(shifts[0, 0]), float(shifts[0, 1]))

    def agreeing(self, query: Any, index: int, shift: Shift) -> npt.NDArray[np.float64]:
        """Return where the regions are that moved by a shift, (n, 4); see `PairScore.agree`."""
        cells = self._map.cells(index)
        if self._exact.agree is None or not cells.any():
            return np.zeros((0, 4))
        return self._exact.agree(query.exact, cells, shift)

    def warm_up(self) -> None:
        """Compile or load what frames will need, so that the first is not late."""
        side = self._map.cell_shape[0]
        cells = np.random.default_rng(0).random(self._map.cell_shape, np.float32)
        drawn = Descriptor(
            cells, np.ones((side - 1) ** 2, np.bool_), np.full((side, side), MAX_BITS), 0.5
        )
        query = self.see(drawn)
        similarity(drawn, drawn)
        for pair, own in ((self._fast, query.fast), (self._exact, query.exact)):
            pair.compare(own, [pair.prepare(cells)])
        if self._keeps_all:
            for index in range(len(self._map)):
                self._reference(index)

    def _prepared(self, pair: PairScore, index: int) -> Any:
        cells = self._map.cells(index)
        return pair.prepare(cells) if cells.any() else None

    def _scored(
        self, pair: PairScore, own: Any, reference: Callable[[int], Any],
        indices: npt.NDArray[np.int64],
    ) -> npt.NDArray[np.float32]:  # fmt: skip
        """Score references in small lots, which this thread and the helpers take in turn."""
        scores = np.full(len(indices), np.nan, np.float32)
        starts = iter(range(0, len(indices), _AT_ONCE))

        def work() -> None:
            for start in starts:
                prepared = [reference(index) for index in indices[start:][:_AT_ONCE].tolist()]
                lot = [place for place, one in enumerate(prepared) if one is not None]
                if lot:
                    found, _ = pair.compare(own, [prepared[place] for place in lot])
                    scores[start + np.array(lot)] = found

        lots = -(-len(indices) // _AT_ONCE)
        helpers = [
            self._pool.submit(work) for _ in range(min(self._helpers, lots - 1)) if self._pool
        ]
        work()
        for helper in helpers:
            if not helper.cancel():
                helper.result()
        return scores
