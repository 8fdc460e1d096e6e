# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ways to score a pair of images, and the matcher that scores a query in a map with one."""

from functools import lru_cache
from typing import Any

from convseq_ros.core.entropy import MAX_BITS
from convseq_ros.core.matching.coherent import COHERENT
from convseq_ros.core.matching.pair_score import PairScore, Regions
from convseq_ros.core.matching.regional import REGIONAL
from convseq_ros.core.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor, Shift
import numpy as np
import numpy.typing as npt

PAIR_SCORES: dict[str, PairScore] = {'coherent': COHERENT, 'regional': REGIONAL}


class Matcher:
    """
    Scores queries against references of a map, whose regions are rebuilt when they are needed.

    Parameters
    ----------
    reference_map : ReferenceMap
        The references.
    matching : str
        Key of `PAIR_SCORES`.
    saliency_threshold : float
        Share of 8 bits of entropy that makes a region of a query salient.
    kept : int, optional
        References whose regions stay in memory (about 120 kB each); all by default.

    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        matching: str,
        saliency_threshold: float,
        kept: int | None = None,
    ) -> None:
        self._pair = PAIR_SCORES[matching]
        self._map = reference_map
        self._least_bits = saliency_threshold * MAX_BITS
        self._reference = lru_cache(kept)(self._prepared)

    def see(self, descriptor: Descriptor) -> Any:
        """Return what is compared of a query, or None if it shows nothing."""
        return self._pair.see(descriptor, self._least_bits)

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
        return np.array([self._score(query, int(index)) for index in indices], np.float32)

    def shift(self, query: Any, index: int) -> Shift | None:
        """Return rows and columns, in cells, from the query to a reference, if known."""
        reference = self._reference(index)
        return None if reference is None else self._pair.compare(query, reference)[1]

    def agreeing(self, query: Any, index: int, shift: Shift) -> npt.NDArray[np.float64]:
        """Return where the regions are that moved by a shift, (n, 4); see `PairScore.agree`."""
        reference = self._reference(index)
        if self._pair.agree is None or reference is None:
            return np.zeros((0, 4))
        return self._pair.agree(query, reference, shift)

    def _score(self, query: Any, index: int) -> float:
        reference = self._reference(index)
        return np.nan if reference is None else self._pair.compare(query, reference)[0]

    def _prepared(self, index: int) -> Regions | None:
        cells = self._map.cells(index)
        return self._pair.prepare(cells) if cells.any() else None
