# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How similar two images of one drive are: by the paper's pair score (III-D), and by ours."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.entropy import ENTROPY
from convseq_ros.core.similarity.kernels.choice import chosen_kernels
from convseq_ros.core.similarity.pair_score import PairScore
from convseq_ros.core.types import Descriptor

_KEPT = 32  # descriptors; longer than any sequence grows by similarity (max_overlap_length)
_PAPER_ERROR = 0.002  # of an 8-bit score; more than its kernel promises
_ERROR = 0.02  # of an 8-bit overlap; twice what its kernel promises


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
        if limit is not None and abs((found := self._fast(query, other)) - limit) > _PAPER_ERROR:
            return found
        return self._exact(query, other)


def _scored(pair: PairScore) -> Callable[[Descriptor, Descriptor], float]:
    """Return what scores two descriptors, each prepared once."""
    extract = lru_cache(_KEPT)(lambda query: pair.extract(query, 0.0, None))
    prepare = lru_cache(_KEPT)(lambda other: pair.prepare(other.cells, None))
    return lambda query, other: float(pair.compare(extract(query), [prepare(other)])[0][0])


class Overlap:
    """
    Compares two images by their coherent score, of the definition, with normalised cells.

    What is left of it after a way depends on how near things are, hardly on the light.
    """

    def __init__(self, saliency_threshold: float, kernel: str = 'auto') -> None:
        fast, exact = chosen_kernels(MatchingConfig(matching='coherent', kernel=kernel))
        self._pairs = (exact,) if fast.exact else (fast, exact)  # the cheapest first
        self._normalize = exact.normalize or (lambda cells: cells)
        self._least_bits = saliency_threshold * ENTROPY.max_bits

    def prepare(self, descriptor: Descriptor) -> tuple[Any, ...]:
        """Return what others are compared with."""
        cells = self._normalize(descriptor.cells)
        return tuple(pair.prepare(cells, None) for pair in self._pairs)

    def since(self, prepared: tuple[Any, ...] | None, descriptor: Descriptor) -> float:
        """Return what moved together, as a share in [0, 1]; 0 since nothing (None)."""
        return [0.0, *self._shares(prepared, descriptor)][-1]

    def is_above(
        self, prepared: tuple[Any, ...] | None, descriptor: Descriptor, share: float
    ) -> bool:
        """Return whether `since` is above a share; what is far from it needs no exact score."""
        found = 0.0
        for found in self._shares(prepared, descriptor):
            if abs(found - share) > _ERROR:
                break
        return found > share

    def _shares(self, prepared: tuple[Any, ...] | None, descriptor: Descriptor) -> Iterator[float]:
        normalized = replace(descriptor, cells=self._normalize(descriptor.cells))
        for pair, one in zip(self._pairs, prepared or (), strict=False):
            query = pair.extract(normalized, self._least_bits, None)
            yield 0.0 if query is None else float(pair.compare(query, [one])[0][0])
