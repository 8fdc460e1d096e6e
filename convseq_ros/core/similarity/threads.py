# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Threads that score pairs, and how many this process may use."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
import os
from pathlib import Path

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
