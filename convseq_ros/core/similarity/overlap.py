# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The similarity of two images of a drive, by the paper's pair score (III-D) and by ours."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.entropy import ENTROPY
from convseq_ros.core.similarity.kernels import chosen_kernels
from convseq_ros.core.similarity.pair_score import PairScore
from convseq_ros.core.types import Descriptor

_KEPT = 32  # cached descriptors; more than `max_overlap_length`
_PAPER_ERROR = 0.002  # of an 8-bit score; above the error of its kernel
_ERROR = 0.02  # of an 8-bit overlap; twice the error of its kernel


class _Scores:
    """Scores pairs of descriptors, exactly if it matters; prepares each descriptor once."""

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

        With a `limit` it may be approximate: 8 bits, four times as fast, and part of the regions
        are used if these lie four standard errors to one side of the limit.
        """
        if limit is None or not self._fast:
            return self._exact(query, other, limit)
        score = self._fast(query, other, limit)
        return score if abs(score - limit) > self._error else self._exact(query, other, None)


class PaperSimilarity(_Scores):
    """The pair score of an informative query and another descriptor."""

    def __init__(self, kernel: str = 'auto') -> None:
        matching = MatchingConfig(matching='regional', kernel=kernel)
        super().__init__(matching, 0.0, _PAPER_ERROR, _KEPT)


class Overlap(_Scores):
    """
    The coherent score of normalised cells, without a background.

    How fast it falls along a drive depends on the distance of things, hardly on the light.
    """

    def __init__(self, saliency_threshold: float, kernel: str = 'auto') -> None:
        matching = MatchingConfig(matching='coherent', kernel=kernel)
        super().__init__(matching, saliency_threshold * ENTROPY.max_bits, _ERROR, kept=2)


def _scored(
    pair: PairScore, least_bits: float, kept: int
) -> Callable[[Descriptor, Descriptor, float | None], float]:
    """Return a function that scores two descriptors; 0 if the query is not informative."""

    @lru_cache(kept)
    def normalized(image: Descriptor) -> Descriptor:
        return replace(image, cells=pair.normalize(image.cells)) if pair.normalize else image

    extract = lru_cache(kept)(lambda query: pair.extract(normalized(query), least_bits, None))
    prepare = lru_cache(kept)(lambda other: pair.prepare(normalized(other).cells, None))

    def score(query: Descriptor, other: Descriptor, limit: float | None) -> float:
        if (features := extract(query)) is None:
            return 0.0
        return float(pair.compare(features, [prepare(other)], limit)[0][0])

    return score
