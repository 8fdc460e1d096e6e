# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The matcher: pair scores of queries with the references of a map (paper III-D)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
import os
from typing import Any

from convseq_ros.config import Config, MatchingConfig
from convseq_ros.core.encoding.entropy import ENTROPY
from convseq_ros.core.encoding.regions import Cells, Regions
from convseq_ros.core.feature_cache import FeatureCache
from convseq_ros.core.map.format import decode_cells, encode_cells
from convseq_ros.core.map.place import pack_cells, unpack_cells
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.background import Background, NoBackground
from convseq_ros.core.similarity.kernels.choice import chosen_kernels
from convseq_ros.core.similarity.pair_score import PairScore
from convseq_ros.core.threads import Threads
from convseq_ros.core.types import Candidate, Descriptor, Shift
import numpy as np
import numpy.typing as npt

Indices = npt.NDArray[np.int64]
Candidates = tuple[Candidate, ...]

_MOST_THREADS = 2  # by default; more gain little, and the SLAM back end needs cores
_KEPT = 1000  # references whose features are kept beside a shortlist; 30 MB
_KEPT_TO_RESCORE = 64  # references of which the exact kernel's features are kept


@dataclass(frozen=True, slots=True)
class Features:
    """What is compared of a query, by the chosen kernel and by an exact one."""

    approximate: Any
    exact: Any


class Matcher:
    """
    Scores queries against references of a map, whose regions are rebuilt when they are needed.

    Parameters
    ----------
    reference_map : ReferenceMap
        The references; more may be added to it later.
    matching : MatchingConfig
        How pairs are scored, by which kernel and by how many threads.
    saliency_threshold : float
        Share of 8 bits of entropy that makes a region of a query salient.
    kept : int, optional
        References whose features stay in memory (30 kB each by the 8-bit kernel, about 120 kB by
        others); all by default.

    Attributes
    ----------
    kernel : str
        What computes `scores`: numbers and instructions.
    exact : bool
        Whether `scores` are those of the definition, to 1e-6, as `exact_scores` always are.

    Raises
    ------
    ConfigError
        If the machine cannot run the kernel that is asked for.

    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        matching: MatchingConfig,
        saliency_threshold: float,
        kept: int | None = None,
    ) -> None:
        self._fast, self._exact = chosen_kernels(matching)
        self.kernel, self.exact = self._fast.name, self._fast.exact
        self._map = reference_map
        self._least_bits = saliency_threshold * ENTROPY.max_bits
        usable = min(len(os.sched_getaffinity(0)), _MOST_THREADS)
        self._threads = Threads((matching.threads or usable) - 1)
        self._background = NoBackground()
        if matching.subtract_background and self._exact.normalize and self._exact.regions:
            self._background = Background(
                reference_map, self._exact.normalize, self._exact.regions
            )
        self._keeps_all = kept is None
        self._features = self._cache(self._fast, kept)
        self._exact_features = self._features
        if self._exact is not self._fast:
            self._exact_features = self._cache(self._exact, _KEPT_TO_RESCORE)

    def extract(self, descriptor: Descriptor) -> Features | None:
        """Return what is compared of a query, each once, or None if it shows nothing."""
        self._follow_map()
        cells = self._background.normalize(descriptor.cells)
        background = self._background.update(cells)
        return self._extracted(replace(descriptor, cells=cells), background)

    def scores(self, query: Features, indices: Indices) -> npt.NDArray[np.float32]:
        """
        Return the pair scores of a query with the references of some indices, (n,).

        In [0, 1]; NaN for a reference that shows nothing.
        """
        return self.scores_of([(query, indices)])[0]

    def scores_of(
        self, asked: Sequence[tuple[Features, Indices]]
    ) -> list[npt.NDArray[np.float32]]:
        """Return what `scores` does for several queries, with all references read in one go."""
        pairs = [(query.approximate, indices) for query, indices in asked]
        return self._scored(self._fast, self._features, pairs)

    def exact_scores(self, query: Features, indices: Indices) -> npt.NDArray[np.float32]:
        """Return what `scores` does, by the definition."""
        return self._scored(self._exact, self._exact_features, [(query.exact, indices)])[0]

    def shift(self, query: Features, index: int) -> Shift | None:
        """Return rows and columns, in cells, from the query to a reference, if known."""
        (reference,) = self._exact_features.of([index])
        if reference is None:
            return None
        shifts = self._exact.compare(query.exact, [reference])[1]
        return None if shifts is None else (float(shifts[0, 0]), float(shifts[0, 1]))

    def with_shift(self, query: Features, candidates: Candidates) -> Candidates:
        """Return at least one candidate, the first of them with its shift, if that is known."""
        shift = self.shift(query, candidates[0].reference_index)
        return replace(candidates[0], shift=shift), *candidates[1:]

    def inliers(self, query: Features, index: int, shift: Shift) -> npt.NDArray[np.float64]:
        """Return where the regions are that moved by a shift, (n, 4), as `PairScore` says."""
        cells, pair = self._background.normalize(self._map.cells(index)), self._exact
        if pair.inliers is None or pair.regions is None or not cells.any():
            return np.zeros((0, 4))
        regions, _ = pair.regions(cells, self._background.of_map)
        return pair.inliers(query.exact, regions, shift)

    def warm_up(self) -> None:
        """Compile or load what frames need, so that the first is not late."""
        self._follow_map()
        shape = self._map.cell_shape
        side = shape[0]
        packed = pack_cells(np.random.default_rng(0).random(shape, np.float32))
        cells = unpack_cells(decode_cells(encode_cells(packed), shape))
        drawn = Descriptor(
            cells, np.ones((side - 1) ** 2, np.bool_), np.full((side, side), ENTROPY.max_bits), 0.5
        )
        background = None
        if self._exact.regions:
            normal = self._background.normalize(cells[::-1])
            background, _ = self._exact.regions(normal, None)
        for pair in (self._fast, self._exact):
            query = pair.extract(drawn, self._least_bits, background)
            pair.compare(query, [pair.prepare(cells, background)])
        if self._keeps_all:
            self._features.of(range(len(self._map)))

    def _cache(self, pair: PairScore, kept: int | None) -> FeatureCache:
        background = self._background

        def prepare(cells: Cells) -> Any:
            return pair.prepare(background.normalize(cells), background.of_map)

        return FeatureCache(self._map, prepare, self._threads, kept)

    def _extracted(self, descriptor: Descriptor, background: Regions | None) -> Features | None:
        fast = self._fast.extract(descriptor, self._least_bits, background)
        if fast is None:
            return None
        if self.exact:
            return Features(fast, fast)
        return Features(fast, self._exact.extract(descriptor, self._least_bits, background))

    def _follow_map(self) -> None:
        if self._background.update_map():
            self._features.clear()
            self._exact_features.clear()

    def _scored(
        self, pair: PairScore, features: FeatureCache, asked: Sequence[tuple[Any, Indices]]
    ) -> list[npt.NDArray[np.float32]]:
        references = iter(features.of([index for _, some in asked for index in some.tolist()]))
        work = [(own, [*islice(references, len(some))]) for own, some in asked]
        found = [np.full(len(some), np.nan, np.float32) for _, some in work]

        def score(piece: int, lot: slice) -> None:
            own, some = work[piece]
            shown = [one for one in some[lot] if one is not None]
            if shown:
                there = [one is not None for one in some[lot]]
                found[piece][lot][there] = pair.compare(own, shown)[0]

        self._threads.run([len(some) for _, some in work], score)
        return found


def make_matcher(reference_map: ReferenceMap, config: Config) -> Matcher:
    """Return the matcher that a configuration asks for."""
    kept = _KEPT if config.matching.search == 'shortlist' else None
    return Matcher(reference_map, config.matching, config.encoding.saliency_threshold, kept)
