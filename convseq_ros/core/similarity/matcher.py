# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The matcher: pair scores of queries with the references of a map (paper III-D)."""

from collections.abc import Sequence
from functools import lru_cache, partial

from convseq_ros.config import Config, MatchingConfig
from convseq_ros.core.encoding.descriptor import ENTROPY
from convseq_ros.core.geometry.verification import (
    field,
    NOTHING,
    packed_regions,
    PackedRegions,
    Verification,
    verify,
)
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.feature_cache import (
    Background,
    FeatureCache,
    Threads,
    usable_cores,
)
from convseq_ros.core.similarity.kernels import coherent_kernel
from convseq_ros.core.similarity.scorer import Features, Scorer
from convseq_ros.core.types import Descriptor, Indices, Row, Shift
import numpy as np
import numpy.typing as npt

_MOST_THREADS = 2  # by default; more gain little, and the SLAM back end needs cores
_KEPT = 500  # references whose features are cached with `search: shortlist`; 22 MB
_ROUGH = 3  # multiple of this number for rough features; 12 MB
_KEPT_TO_VERIFY = 64  # references whose regions are cached for the geometry; 2 MB


class Matcher(Scorer):
    """
    Scores queries against the references of a map, which may grow.

    Features of `kept` references stay in memory, by default of all: 43 kB each. Rough features, a
    fifth in size, are kept of three times as many.
    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        matching: MatchingConfig,
        saliency_threshold: float,
        kept: int | None = None,
    ) -> None:
        pair = coherent_kernel()
        self.kernel = pair.name
        self._map, self._keeps_all = reference_map, kept is None
        self._least_bits = saliency_threshold * ENTROPY.max_bits
        usable = min(usable_cores(), _MOST_THREADS)
        self._background = Background(reference_map, pair)
        shared = self._background, Threads((matching.threads or usable) - 1)
        self._features = FeatureCache(reference_map, pair, *shared, kept)
        self._rough = FeatureCache(reference_map, pair.rough, *shared, kept and _ROUGH * kept)
        # Not a bound method: without a reference cycle, an unused map is freed at once.
        self._kept_packed = lru_cache(_KEPT_TO_VERIFY)(partial(_packed, self._features))

    def reset(self) -> None:
        self._background.reset()

    def extract(self, descriptor: Descriptor) -> Features | None:
        self._follow_map()
        pair = self._features.pair
        projected = pair.project(pair.normalize(descriptor.cells))
        regions = pair.subtract(projected, self._background.update(projected))
        given = descriptor, self._least_bits, regions
        if (scored := pair.extract(*given)) is None:
            return None
        return Features(scored, packed_regions(regions[0]), pair.rough.extract(*given))

    def packed(self, index: int) -> PackedRegions | None:
        return self._kept_packed(index)

    def scores_of(self, requests: Sequence[tuple[Features, Indices]]) -> list[Row]:
        return self._features.scores_of([(query.scored, indices) for query, indices in requests])

    def rough_scores(self, query: Features, indices: Indices) -> Row | None:
        if query.rough is None:
            return None
        return self._rough.scores_of([(query.rough, indices)])[0]

    def shift(self, query: Features, index: int) -> Shift | None:
        return self._features.shifts(query.scored, [index])[0]

    def field(self, query: Features, index: int, shift: Shift) -> npt.NDArray[np.float64]:
        reference = self.packed(index)
        if query.packed is None or reference is None:
            return np.zeros((0, 5))
        return field(query.packed, reference, shift)

    def verified(self, query: Features, indices: Sequence[int]) -> dict[int, Verification]:
        if query.packed is None:
            return {}
        shifts = self._features.shifts(query.scored, indices)
        rows = zip(indices, shifts, map(self.packed, indices), strict=True)
        usable = [row for row in rows if row[1] is not None and row[2] is not None]
        results = dict.fromkeys(indices, NOTHING)
        if usable:
            verified, starts, references = zip(*usable, strict=True)
            results |= zip(verified, verify(query.packed, references, starts), strict=True)
        return results

    def warm_up(self) -> None:
        self._follow_map()
        if self._keeps_all:
            self._features.of(range(len(self._map)))

    def _follow_map(self) -> None:
        if self._background.update_map():
            self._features.clear()
            self._rough.clear()
            self._kept_packed.cache_clear()


def _packed(features: FeatureCache, index: int) -> PackedRegions | None:
    (reference,) = features.of([index])
    return None if reference is None else packed_regions(features.pair.regions_of(reference))


def make_matcher(reference_map: ReferenceMap, config: Config) -> Matcher:
    """Return the matcher of a configuration."""
    kept = _KEPT if config.matching.search == 'shortlist' else None
    threshold = config.encoding.saliency_threshold
    return Matcher(reference_map, config.matching, threshold, kept)
