# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How similar two images of one drive are, by the paper's pair score (III-D)."""

from functools import lru_cache

from convseq_ros.config import MatchingConfig
from convseq_ros.core.similarity.kernels.choice import chosen_kernels
from convseq_ros.core.types import Descriptor

_KEPT = 32  # descriptors; longer than any sequence grows by similarity (max_overlap_length)


class PaperSimilarity:
    """Scores pairs of descriptors by the definition, with any kernel; prepares each once."""

    def __init__(self, kernel: str = 'auto') -> None:
        _, pair = chosen_kernels(MatchingConfig(matching='regional', kernel=kernel))
        self._compare = pair.compare
        self._extract = lru_cache(_KEPT)(lambda query: pair.extract(query, 0.0, None))
        self._prepare = lru_cache(_KEPT)(lambda other: pair.prepare(other.cells, None))

    def __call__(self, query: Descriptor, other: Descriptor) -> float:
        """Return the pair score of an informative query and another descriptor, in [0, 1]."""
        return float(self._compare(self._extract(query), [self._prepare(other)])[0][0])
