# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The matcher: pair scores of queries with the references of a map (paper III-D)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from typing import Any

from convseq_ros.config import Config, MatchingConfig
from convseq_ros.core.encoding.descriptor import ENTROPY
from convseq_ros.core.encoding.first_stage import vector_of
from convseq_ros.core.encoding.regions import unit
from convseq_ros.core.geometry.displacement import Arranged, arranged
from convseq_ros.core.geometry.verification import field, NOTHING, Verification, verify
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.background import Background
from convseq_ros.core.similarity.feature_cache import FeatureCache, Threads, usable_cores
from convseq_ros.core.similarity.kernels import chosen_kernels
from convseq_ros.core.types import Descriptor, Indices, Row, Shift
from convseq_ros.errors import ConfigError
import numpy as np
import numpy.typing as npt

_MOST_THREADS = 2  # by default; more gain little, and the SLAM back end needs cores
_KEPT = 500  # references whose features are kept beside a shortlist; 22 MB
_ROUGH = 8  # rough ones are kept of so many times as many; 30 MB
_KEPT_TO_RESCORE = 64  # references of which the exact kernel's features are kept
_KEPT_TO_VERIFY = 64  # references that are kept as geometry reads them; 2 MB


@dataclass(frozen=True, slots=True)
class Features:
    """What is compared of a query."""

    approximate: Any  # by the chosen kernel
    exact: Callable[[], Any]  # by an exact one, made when it is asked for
    arranged: Arranged | None = None  # by the geometry
    rough: Any = None  # for rough scores


class Matcher:
    """
    Scores queries against references of a map, which may grow; rebuilds regions when needed.

    Features of `kept` references, or of all, stay in memory: 43 kB each by the 8-bit kernel, about
    130 kB by others; and rough ones, of a sixth of that, of 8 times as many. ConfigError if the
    machine cannot run the kernel asked for.
    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        matching: MatchingConfig,
        saliency_threshold: float,
        kept: int | None = None,
    ) -> None:
        fast, exact = chosen_kernels(matching)
        # What computes scores, and whether they are the definition's to 1e-6.
        self.kernel, self.exact = fast.name, fast.exact
        self._map, self._keeps_all = reference_map, kept is None
        self._least_bits = saliency_threshold * ENTROPY.max_bits
        usable = min(usable_cores(), _MOST_THREADS)
        threads = Threads((matching.threads or usable) - 1)
        subtracted = (exact.normalize, exact.project) if matching.subtract_background else ()
        self._background = own = Background(reference_map, *subtracted)
        self._fast = self._exact = FeatureCache(reference_map, fast, own, threads, kept)
        if exact is not fast:
            self._exact = FeatureCache(reference_map, exact, own, threads, _KEPT_TO_RESCORE)
        self._rough: FeatureCache | None = None
        if fast.rough:
            most = kept and _ROUGH * kept
            self._rough = FeatureCache(reference_map, fast.rough, own, threads, most)
        # Without a reference to itself, so that a map that nobody has any more is freed at once.
        self._kept_arranged = lru_cache(_KEPT_TO_VERIFY)(partial(_arranged, self._fast))

    def reset(self) -> None:
        self._background.reset()

    def extract(self, descriptor: Descriptor) -> Features | None:
        """Return what is compared of a query, or None if it shows nothing."""
        self._follow_map()
        pair, shown = self._exact.pair, None
        if pair.project and pair.subtract:
            regions = pair.project(self._background.normalize(descriptor.cells))
            shown = pair.subtract(regions, self._background.update(regions))
        asked = descriptor, self._least_bits, shown
        if (fast := self._fast.pair.extract(*asked)) is None:
            return None
        exact = (lambda: fast) if self.exact else cache(partial(pair.extract, *asked))
        if not shown:
            return Features(fast, exact)
        rough = self._rough and self._rough.pair.extract(*asked)
        return Features(fast, exact, arranged(shown[0]), rough)

    def arranged(self, index: int) -> Arranged | None:
        """Return a reference as geometry reads it; None if it shows nothing, or has no regions."""
        return self._kept_arranged(index)

    def scores_of(self, asked: Sequence[tuple[Features, Indices]]) -> list[Row]:
        """
        Return pair scores of queries with references each, (n,), in [0, 1].

        They are NaN where a reference shows nothing; all references are read in one go.
        """
        return self._fast.scores_of([(query.approximate, indices) for query, indices in asked])

    def rough_scores(self, query: Features, indices: Indices) -> Row | None:
        """Return rough scores (n,), by a sixteenth of the work; None if the kernel has none."""
        if query.rough is None or self._rough is None:
            return None
        return self._rough.scores_of([(query.rough, indices)])[0]

    def exact_scores_of(self, asked: Sequence[tuple[Features, Indices]]) -> list[Row]:
        """Return what `scores_of` does, by the definition."""
        return self._exact.scores_of([(query.exact(), indices) for query, indices in asked])

    def shift(self, query: Features, index: int) -> Shift | None:
        """Return rows and columns, in cells, from the query to a reference, if known."""
        return self._fast.shifts(query.approximate, [index])[0]

    def field(self, query: Features, index: int, shift: Shift) -> npt.NDArray[np.float64]:
        """Return where regions of a query lie in a reference, (n, 5), as `verification.field`."""
        reference = self.arranged(index)
        if query.arranged is None or reference is None:
            return np.zeros((0, 5))
        return field(query.arranged, reference, shift)

    def verified(self, query: Features, indices: Sequence[int]) -> dict[int, Verification]:
        """Return what geometry says of a query and some references; nothing without regions."""
        if query.arranged is None:
            return {}
        shifts = self._fast.shifts(query.approximate, indices)
        read = zip(indices, shifts, map(self.arranged, indices), strict=True)
        shown = [one for one in read if one[1] is not None and one[2] is not None]
        found = dict.fromkeys(indices, NOTHING)
        if shown:
            known, starts, references = zip(*shown, strict=True)
            found |= zip(known, verify(query.arranged, references, starts), strict=True)
        return found

    def warm_up(self) -> None:
        """Make what is compared of all references, if it is kept, so that no frame is late."""
        self._follow_map()
        if self._keeps_all:
            self._fast.of(range(len(self._map)))

    def _follow_map(self) -> None:
        if self._background.update_map():
            for kept in (self._fast, self._exact, self._rough):
                if kept:
                    kept.clear()
            self._kept_arranged.cache_clear()


def _arranged(features: FeatureCache, index: int) -> Arranged | None:
    regions_of, (reference,) = features.pair.regions_of, features.of([index])
    return arranged(regions_of(reference)) if regions_of and reference is not None else None


class DescriptorMatcher(Matcher):
    """Scores pairs by the cosines of their vectors, without cells, shifts or geometry."""

    def __init__(self, reference_map: ReferenceMap) -> None:
        self.kernel, self.exact, self._map = 'cosine', True, reference_map

    def reset(self) -> None: ...

    def extract(self, descriptor: Descriptor) -> Features | None:
        """Return the vector of a query at unit length, or None if it shows nothing."""
        vector = unit(vector_of(descriptor).astype(np.float32))
        return Features(vector, lambda: vector) if vector.any() else None

    def scores_of(self, asked: Sequence[tuple[Features, Indices]]) -> list[Row]:
        """Return cosines of at least 0."""
        found = []
        for query, indices in asked:
            rows = unit(self._map.global_descriptors[indices].astype(np.float32))
            found.append(np.maximum(rows @ query.approximate, 0.0))
        return found

    def shift(self, _query: Features, _index: int) -> Shift | None:
        """Return None: it is not known."""
        return None

    def arranged(self, _index: int) -> Arranged | None:
        """Return None: geometry is not asked."""
        return None

    def warm_up(self) -> None: ...


def make_matcher(reference_map: ReferenceMap, config: Config) -> Matcher:
    """Return the matcher that a configuration asks for."""
    if config.matching.matching == 'descriptor':
        return DescriptorMatcher(reference_map)
    if not reference_map.encoding.keeps_cells:
        raise ConfigError(
            f'matching: {config.matching.matching} needs cells, the map keeps none; set matching '
            'to descriptor'
        )
    kept = _KEPT if config.matching.search == 'shortlist' else None
    threshold = config.encoding.saliency_threshold
    return Matcher(reference_map, config.matching, threshold, kept)
