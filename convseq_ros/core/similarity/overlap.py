# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How similar two images of one drive are: by the paper's pair score (III-D), and by ours."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.descriptor import ENTROPY
from convseq_ros.core.similarity.kernels import chosen_kernels
from convseq_ros.core.similarity.pair_score import PairScore
from convseq_ros.core.types import Descriptor

_KEPT = 32  # descriptors; longer than any sequence grows by similarity (max_overlap_length)
_PAPER_ERROR = 0.002  # of an 8-bit score; more than its kernel promises
_ERROR = 0.02  # of an 8-bit overlap; twice what its kernel promises


class _Scores:
    """Scores pairs of descriptors by the definition, with any kernel; prepares each once."""

    def __init__(
        self, matching: MatchingConfig, least_bits: float, error: float, kept: int
    ) -> None:
        fast, exact = chosen_kernels(matching)
        self._exact = _scored(exact, least_bits, kept)
        self._fast = None if fast.exact else _scored(fast, least_bits, kept)
        self._error = error

    def __call__(self, query: Descriptor, other: Descriptor, limit: float | None = None) -> float:
        """
        Return the score of a query and another descriptor, in [0, 1].

        By 8 bits, four times as fast, and of some regions, if that tells on which side of a limit
        it lies.
        """
        if limit is None or not self._fast:
            return self._exact(query, other, limit)
        found = self._fast(query, other, limit)
        return found if abs(found - limit) > self._error else self._exact(query, other, None)


class PaperSimilarity(_Scores):
    """The pair score of an informative query and another descriptor."""

    def __init__(self, kernel: str = 'auto') -> None:
        matching = MatchingConfig(matching='regional', kernel=kernel)
        super().__init__(matching, 0.0, _PAPER_ERROR, _KEPT)


class Overlap(_Scores):
    """
    The coherent score of normalised cells: what moved together from the other image to the query.

    What is left of it after a way depends on how near things are, hardly on the light.
    """

    def __init__(self, saliency_threshold: float, kernel: str = 'auto') -> None:
        matching = MatchingConfig(matching='coherent', kernel=kernel)
        super().__init__(matching, saliency_threshold * ENTROPY.max_bits, _ERROR, kept=2)


def _scored(
    pair: PairScore, least_bits: float, kept: int
) -> Callable[[Descriptor, Descriptor, float | None], float]:
    """Return what scores two descriptors, each prepared once; 0 if the query shows nothing."""

    @lru_cache(kept)
    def seen(one: Descriptor) -> Descriptor:
        return replace(one, cells=pair.normalize(one.cells)) if pair.normalize else one

    extract = lru_cache(kept)(lambda query: pair.extract(seen(query), least_bits, None))
    prepare = lru_cache(kept)(lambda other: pair.prepare(seen(other).cells, None))

    def score(query: Descriptor, other: Descriptor, limit: float | None) -> float:
        if (asked := extract(query)) is None:
            return 0.0
        return float(pair.compare(asked, [prepare(other)], limit)[0][0])

    return score
