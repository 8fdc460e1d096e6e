# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is compared of references, made when it is needed first, and scored by some threads."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
import os
from pathlib import Path
from typing import Any

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.background import Background
from convseq_ros.core.similarity.pair_score import PairScore
from convseq_ros.core.types import Indices, Row, Shift
import numpy as np

_AT_ONCE = 8  # references in a lot; measured: fewer cost more calls, more leave threads idle
_READ_AT_ONCE = 256  # references, for 8 MB of cells


def usable_cores(cgroups: Path = Path('/sys/fs/cgroup')) -> int:
    """Return how many cores this process may use: its own, and what its group's quota pays for."""
    cores = len(os.sched_getaffinity(0))
    for name in ('cpu.max', 'cpu/cpu.cfs_quota_us'):  # cgroup 2, then 1
        with suppress(OSError, ValueError):
            quota, *period = (cgroups / name).read_text(encoding='ascii').split()
            if not period:
                period = (cgroups / 'cpu/cpu.cfs_period_us').read_text(encoding='ascii').split()
            if int(quota) > 0:  # 'max' is no number, and -1 no quota
                return max(1, min(cores, int(quota) // int(period[0])))
    return cores


class Threads:
    """Splits work between the calling thread and so many helpers."""

    def __init__(self, helpers: int) -> None:
        self._helpers = helpers
        self._pool = ThreadPoolExecutor(max(1, helpers), 'pairs')  # starts none before `run`

    def run(self, counts: Sequence[int], job: Callable[[int, slice], None]) -> None:
        """Call a job with the number of each piece of work, and slices of its so many things."""
        at_once = _AT_ONCE if self._helpers else max(counts, default=0) or 1
        lots = [
            (piece, slice(start, min(start + at_once, count)))
            for piece, count in enumerate(counts)
            for start in range(0, count, at_once)
        ]
        waiting = iter(lots)  # of all threads

        def work() -> None:
            for lot in waiting:
                job(*lot)

        helpers = [self._pool.submit(work) for _ in range(min(self._helpers, len(lots) - 1))]
        work()
        for helper in helpers:
            if not helper.cancel():
                helper.result()


@dataclass(eq=False, slots=True)
class FeatureCache:
    """Makes what a kernel compares of references; keeps all, or `most`, the last asked for."""

    _map: ReferenceMap
    pair: PairScore
    _background: Background
    _threads: Threads
    _most: int | None
    _kept: dict[int, Any] = field(default_factory=dict)
    _query: Any = None  # the first of those that were asked for last, and its shifts
    _shifts: dict[int, Shift] = field(default_factory=dict)

    def clear(self) -> None:
        self._kept.clear()
        self._query = None

    def of(self, indices: Sequence[int]) -> list[Any]:
        """Return what is compared of references, None for each that shows nothing; or MapError."""
        found = {index: self._kept[index] for index in indices if index in self._kept}
        missing = iter([index for index in dict.fromkeys(indices) if index not in found])
        while some := [*islice(missing, _READ_AT_ONCE)]:
            found.update(zip(some, self._made(some), strict=True))
        if self._most is not None:  # then the newest lie behind
            for index in found:
                self._kept.pop(index, None)
        self._kept.update(found)
        most = len(self._kept) if self._most is None else self._most
        for index in [*islice(self._kept, max(0, len(self._kept) - most))]:
            del self._kept[index]
        return [found[index] for index in indices]

    def scores_of(self, asked: Sequence[tuple[Any, Indices]]) -> list[Row]:
        """Return the scores of queries with some references each; NaN where one shows nothing."""
        references = iter(self.of([index for _, some in asked for index in some.tolist()]))
        work = [(own, [*islice(references, len(some))]) for own, some in asked]
        found = [np.full(len(some), np.nan, np.float32) for _, some in work]
        if asked:
            self._begin(asked[0][0])

        def score(piece: int, lot: slice) -> None:
            own, some = work[piece]
            there = [place for place in range(lot.start, lot.stop) if some[place] is not None]
            if there:
                scores, shifts = self.pair.compare(own, [some[place] for place in there])
                found[piece][there] = scores
                if own is self._query and shifts is not None:
                    indices = asked[piece][1][there].tolist()
                    self._shifts.update(zip(indices, map(tuple, shifts.tolist()), strict=True))

        self._threads.run([len(some) for _, some in work], score)
        return found

    def _begin(self, query: Any) -> None:
        if query is not self._query:
            self._query, self._shifts = query, {}

    def shifts(self, query: Any, indices: Sequence[int]) -> list[Shift | None]:
        """Return rows and columns, in cells, from a query to each reference, as far as known."""
        self._begin(query)
        unknown = [index for index in indices if index not in self._shifts]
        self.scores_of([(query, np.array(unknown, np.int64))])  # takes note of shifts
        return [self._shifts.get(index) for index in indices]

    def _made(self, indices: Sequence[int]) -> list[Any]:
        packed, own = self._map.packed_of(indices), self._background
        made: list[Any] = [None] * len(packed)

        def prepare(_: int, lot: slice) -> None:
            made[lot] = self.pair.prepare_packed(packed[lot], own.normalizes, own.of_map)

        self._threads.run([len(packed)], prepare)
        return made
