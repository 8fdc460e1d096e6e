# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The features of references, computed on first use, and their scores, on several threads.

All images of a road or corridor have the same layout, so regions find counterparts at their own
position at every place, right or wrong. Therefore the background, the mean of each region, is
subtracted: the map's from references, and the drive's from queries, since the same scene looks
different at night.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
import os
from pathlib import Path
from typing import Any

from convseq_ros.core.encoding.regions import Regions
from convseq_ros.core.map.place import unpack_cells
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.coherent import CoherentPair
from convseq_ros.core.types import constants, Indices, Row, Shift
import numpy as np

_SAMPLED_AT_ONCE = 16  # places of the sample, for 1 MB of cells


@constants
class BACKGROUND:
    """Tuned on 29 sets, by day and darkened (commit ad68631c), except for the sample."""

    fewest_places: int = 20  # a map with fewer places has no background
    sample: int = 256  # number of places that are averaged; more make no difference
    prior_frames: int = 5  # weight of the map's background in the drive's, in frames
    still_alike: float = 0.8  # mean cosine of two frames from which the later one is skipped


class Background:
    """
    The backgrounds of a map, `of_map` (N, 32), and of the drive that is matched with it.

    It is the mean of up to 256 evenly spread places, computed again whenever the map has doubled.
    A map of fewer than 20 places has none. The `pair` normalises and projects.
    """

    def __init__(self, reference_map: ReferenceMap, pair: CoherentPair) -> None:
        self._map, self._pair = reference_map, pair
        self.of_map: Regions | None = None
        self._averaged = 0
        self.reset()

    def reset(self) -> None:
        self._last: Regions | None = None
        self._sum = np.zeros(1, np.float32)
        self._frames = 0

    def update_map(self) -> bool:
        """Average the map again if it has doubled; return whether `of_map` has changed."""
        count = len(self._map)
        if count < max(BACKGROUND.fewest_places, 2 * self._averaged):
            return False
        spread = np.linspace(0, count - 1, min(count, BACKGROUND.sample)).astype(int)
        sample, total, number = np.unique(spread).tolist(), np.zeros(1, np.float32), 0
        for start in range(0, len(sample), _SAMPLED_AT_ONCE):
            packed = self._map.packed_of(sample[start : start + _SAMPLED_AT_ONCE])
            for cells in map(unpack_cells, packed):
                if cells.any():
                    regions = self._pair.project(self._pair.normalize(cells))
                    total, number = total + regions, number + 1
        self.of_map = total / np.float32(number) if number else None
        self._averaged = count
        return True

    def update(self, regions: Regions) -> Regions | None:
        """
        Take in a query's projected regions, each only once; return the drive's background (N, 32).

        A frame that is too similar to the last counted one is skipped. The map's background counts
        as 5 frames. The result is None while the map has no background.
        """
        limit, last = BACKGROUND.still_alike * len(regions), self._last
        # Not by BLAS: for so few products, starting its threads takes longer than the work.
        if last is None or np.einsum('ij,ij', regions, last, dtype=np.float64) < limit:
            self._last, self._sum = regions, self._sum + regions
            self._frames += 1
        if self.of_map is None:
            return None
        total = self._sum + BACKGROUND.prior_frames * self.of_map
        return np.asarray(total / (self._frames + BACKGROUND.prior_frames), np.float32)


_AT_ONCE = 8  # references in a batch; measured: fewer cost more calls, more leave threads idle


def usable_cores(cgroup: Path = Path('/sys/fs/cgroup/cpu.max')) -> int:
    """Return how many cores this process may use, by its affinity and its cgroup's quota."""
    cores = len(os.sched_getaffinity(0))
    with suppress(OSError, ValueError):  # the text 'max' is no quota
        quota, period = map(int, cgroup.read_text(encoding='ascii').split())
        return max(1, min(cores, quota // period))
    return cores


class Threads:
    """Splits work between the calling thread and `helpers` more threads."""

    def __init__(self, helpers: int) -> None:
        self._helpers = helpers
        self._pool = ThreadPoolExecutor(max(1, helpers), 'pairs')  # threads start in `run`

    def run(self, counts: Sequence[int], job: Callable[[int, slice], None]) -> None:
        """Call job(index, batch) for batches, slices that cover the items of `counts[index]`."""
        at_once = _AT_ONCE if self._helpers else max(counts, default=0) or 1
        batches = [
            (index, slice(start, min(start + at_once, count)))
            for index, count in enumerate(counts)
            for start in range(0, count, at_once)
        ]
        waiting = iter(batches)  # shared by all threads

        def work() -> None:
            for batch in waiting:
                job(*batch)

        helpers = [self._pool.submit(work) for _ in range(min(self._helpers, len(batches) - 1))]
        work()
        for helper in helpers:
            if not helper.cancel():
                helper.result()


_READ_AT_ONCE = 256  # references that are read at once, for 8 MB of cells


@dataclass(eq=False, slots=True)
class FeatureCache:
    """Computes a kernel's features of references; keeps all, or the `_most` recently used."""

    _map: ReferenceMap
    pair: CoherentPair
    _background: Background
    _threads: Threads
    _most: int | None
    _kept: dict[int, Any] = field(default_factory=dict)
    _query: Any = None  # the first query of the last request, whose shifts are kept
    _shifts: dict[int, Shift] = field(default_factory=dict)  # by reference

    def clear(self) -> None:
        self._kept.clear()
        self._query = None

    def of(self, indices: Sequence[int]) -> list[Any]:
        """Return the features of references, None for blank ones; MapError if unreadable."""
        features = {index: self._kept[index] for index in indices if index in self._kept}
        missing = iter([index for index in dict.fromkeys(indices) if index not in features])
        while batch := [*islice(missing, _READ_AT_ONCE)]:
            features.update(zip(batch, self._made(batch), strict=True))
        if self._most is not None:  # move recently used ones to the end
            for index in features:
                self._kept.pop(index, None)
        self._kept.update(features)
        most = len(self._kept) if self._most is None else self._most
        for index in [*islice(self._kept, max(0, len(self._kept) - most))]:
            del self._kept[index]
        return [features[index] for index in indices]

    def scores_of(self, requests: Sequence[tuple[Any, Indices]]) -> list[Row]:
        """Return the scores of each query with its references; NaN for blank references."""
        features = iter(self.of([index for _, places in requests for index in places.tolist()]))
        work = [(query, [*islice(features, len(places))]) for query, places in requests]
        results = [np.full(len(references), np.nan, np.float32) for _, references in work]
        if requests:
            self._begin(requests[0][0])

        def score(request: int, batch: slice) -> None:
            query, references = work[request]
            kept = [at for at in range(batch.start, batch.stop) if references[at] is not None]
            if kept:
                scores, shifts = self.pair.compare(query, [references[at] for at in kept])
                results[request][kept] = scores
                if query is self._query:
                    indices = requests[request][1][kept].tolist()
                    self._shifts.update(zip(indices, map(tuple, shifts.tolist()), strict=True))

        self._threads.run([len(references) for _, references in work], score)
        return results

    def _begin(self, query: Any) -> None:
        if query is not self._query:
            self._query, self._shifts = query, {}

    def shifts(self, query: Any, indices: Sequence[int]) -> list[Shift | None]:
        """Return shifts from a query to references, rows and columns in cells, if known."""
        self._begin(query)
        unknown = [index for index in indices if index not in self._shifts]
        self.scores_of([(query, np.array(unknown, np.int64))])  # fills in `_shifts`
        return [self._shifts.get(index) for index in indices]

    def _made(self, indices: Sequence[int]) -> list[Any]:
        packed, background = self._map.packed_of(indices), self._background.of_map
        features: list[Any] = [None] * len(packed)

        def prepare(_: int, part: slice) -> None:
            features[part] = self.pair.prepare_packed(packed[part], background)

        self._threads.run([len(packed)], prepare)
        return features
