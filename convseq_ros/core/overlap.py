# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much of an image moved together since another of the same drive."""

from dataclasses import replace
from typing import Any

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.entropy import MAX_BITS
from convseq_ros.core.similarity.choice import chosen_kernels
from convseq_ros.core.types import Descriptor


class Overlap:
    """
    Compares images with one that is remembered, by their coherent score with evened cells.

    A robot that drives on sees less and less move together, by day as in the evening: what is left
    after a way depends on how near things are, hardly on the light.

    Parameters
    ----------
    saliency_threshold : float
        Share of 8 bits of entropy that makes a region salient.
    kernel : str
        As in MatchingConfig; its scores are those of the definition in any case.

    """

    def __init__(self, saliency_threshold: float, kernel: str = 'auto') -> None:
        matching = MatchingConfig(matching='coherent', kernel=kernel)
        _, self._pair = chosen_kernels(matching)
        self._least_bits = saliency_threshold * MAX_BITS
        self._remembered: Any = None

    def forget(self) -> None:
        """Remember no image."""
        self._remembered = None

    def remember(self, descriptor: Descriptor) -> None:
        """Compare with this image from now on."""
        self._remembered = self._pair.prepare(self._evened(descriptor).cells, None)

    def of(self, descriptor: Descriptor) -> float:
        """Return what moved together, as a share in [0, 1]; 0 where nothing is remembered."""
        seen = self._pair.see(self._evened(descriptor), self._least_bits, None)
        if seen is None or self._remembered is None:
            return 0.0
        scores, _ = self._pair.compare(seen, [self._remembered])
        return float(scores[0])

    def _evened(self, descriptor: Descriptor) -> Descriptor:
        look = self._pair.look
        return replace(descriptor, cells=look.even(descriptor.cells)) if look else descriptor
