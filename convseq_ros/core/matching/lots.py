# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work in small lots, which the calling thread and some helpers take in turn."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

_AT_ONCE = 16


class Lots:
    """
    Splits work between the calling thread and helpers.

    Parameters
    ----------
    helpers : int
        How many threads there are besides the calling one.

    """

    def __init__(self, helpers: int) -> None:
        self._helpers = helpers
        self._pool = ThreadPoolExecutor(helpers, 'pairs') if helpers else None

    def run(self, count: int, job: Callable[[slice], None]) -> None:
        """Call a job with slices that together are the first so many; return when all is done."""
        starts = iter(range(0, count, _AT_ONCE))

        def work() -> None:
            for start in starts:
                job(slice(start, min(start + _AT_ONCE, count)))

        most = min(self._helpers, -(-count // _AT_ONCE) - 1)
        helpers = [self._pool.submit(work) for _ in range(most) if self._pool]
        work()
        for helper in helpers:
            if not helper.cancel():
                helper.result()
