# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much of an image moved together since another."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.entropy import ENTROPY
from convseq_ros.core.similarity.kernels.choice import chosen_kernels
from convseq_ros.core.types import Descriptor

_ERROR = 0.02  # of an 8-bit overlap; twice what its kernel promises


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
