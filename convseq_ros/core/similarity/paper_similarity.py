# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How similar two images of one drive are, by the paper's pair score (III-D)."""

from collections.abc import Callable
from functools import lru_cache

from convseq_ros.config import MatchingConfig
from convseq_ros.core.similarity.kernels.choice import chosen_kernels
from convseq_ros.core.similarity.pair_score import PairScore
from convseq_ros.core.types import Descriptor

_KEPT = 32  # descriptors; longer than any sequence grows by similarity (max_overlap_length)
_ERROR = 0.002  # of an 8-bit score; more than its kernel promises


class PaperSimilarity:
    """Scores pairs of descriptors by the definition, with any kernel; prepares each once."""

    def __init__(self, kernel: str = 'auto') -> None:
        fast, exact = chosen_kernels(MatchingConfig(matching='regional', kernel=kernel))
        self._exact = _scored(exact)
        self._fast = self._exact if fast.exact else _scored(fast)

    def __call__(self, query: Descriptor, other: Descriptor, limit: float | None = None) -> float:
        """
        Return the pair score of an informative query and another descriptor, in [0, 1].

        By 8 bits, four times as fast, if that tells on which side of a limit it lies.
        """
        if limit is not None and abs((found := self._fast(query, other)) - limit) > _ERROR:
            return found
        return self._exact(query, other)


def _scored(pair: PairScore) -> Callable[[Descriptor, Descriptor], float]:
    """Return what scores two descriptors, each prepared once."""
    extract = lru_cache(_KEPT)(lambda query: pair.extract(query, 0.0, None))
    prepare = lru_cache(_KEPT)(lambda other: pair.prepare(other.cells, None))
    return lambda query, other: float(pair.compare(extract(query), [prepare(other)])[0][0])
