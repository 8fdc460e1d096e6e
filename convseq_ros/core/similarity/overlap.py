# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The overlap of two images of a drive: the share of regions that moved together."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

from convseq_ros.core.encoding.entropy import ENTROPY
from convseq_ros.core.similarity.kernels import coherent_kernel
from convseq_ros.core.types import Descriptor

_KEPT = 2  # cached descriptors


class Overlap:
    """
    The coherent score of normalised cells, without a background; prepares each descriptor once.

    How fast it falls along a drive depends on the distance of things, hardly on the light.
    """

    def __init__(self, saliency_threshold: float) -> None:
        pair, least_bits = coherent_kernel(), saliency_threshold * ENTROPY.max_bits

        @lru_cache(_KEPT)
        def normalized(image: Descriptor) -> Descriptor:
            return replace(image, cells=pair.normalize(image.cells))

        @lru_cache(_KEPT)
        def extracted(query: Descriptor) -> Any:
            return pair.extract(normalized(query), least_bits)

        @lru_cache(_KEPT)
        def prepared(other: Descriptor) -> Any:
            return pair.prepare(normalized(other).cells, None)

        self._pair, self._extracted, self._prepared = pair, extracted, prepared

    def __call__(self, query: Descriptor, other: Descriptor) -> float:
        """Return the score of a query and another image, in [0, 1]; 0 for one without regions."""
        if (features := self._extracted(query)) is None:
            return 0.0
        return float(self._pair.compare(features, [self._prepared(other)])[0][0])
