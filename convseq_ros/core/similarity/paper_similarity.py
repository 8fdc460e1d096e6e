# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How similar two images of one drive are, by the paper's pair score (III-D)."""

from collections import OrderedDict
from typing import Any

from convseq_ros.config import MatchingConfig
from convseq_ros.core.similarity.kernels.choice import chosen_kernels
from convseq_ros.core.types import Descriptor

_KEPT = 32  # descriptors; longer than any sequence grows by similarity (max_overlap_length)


class PaperSimilarity:
    """Scores pairs of descriptors by the definition, with any kernel; prepares each once."""

    def __init__(self, kernel: str = 'auto') -> None:
        _, self._pair = chosen_kernels(MatchingConfig(matching='regional', kernel=kernel))
        self._query: tuple[Descriptor | None, Any] = None, None
        self._prepared: OrderedDict[int, tuple[Descriptor, Any]] = OrderedDict()

    def __call__(self, query: Descriptor, other: Descriptor) -> float:
        """Return the pair score of an informative query and another descriptor, in [0, 1]."""
        if self._query[0] is not query:
            self._query = query, self._pair.extract(query, 0.0, None)
        if id(other) not in self._prepared:
            self._prepared[id(other)] = other, self._pair.prepare(other.cells, None)
        while len(self._prepared) > _KEPT:
            self._prepared.popitem(last=False)
        self._prepared.move_to_end(id(other))
        return float(self._pair.compare(self._query[1], [self._prepared[id(other)][1]])[0][0])
