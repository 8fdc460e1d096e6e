# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work in small lots, which the calling thread and some helpers take in turn."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

_AT_ONCE = 8


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

    def run(self, counts: Sequence[int], job: Callable[[int, slice], None]) -> None:
        """
        Call a job with all parts of some pieces of work; return when all is done.

        Parameters
        ----------
        counts : sequence of int
            How much each piece consists of.
        job : callable
            Of the number of a piece and a slice of it.

        """
        parts = [
            (piece, slice(start, min(start + _AT_ONCE, count)))
            for piece, count in enumerate(counts)
            for start in range(0, count, _AT_ONCE)
        ]
        waiting = iter(parts)

        def work() -> None:
            for piece, part in waiting:
                job(piece, part)

        most = min(self._helpers, len(parts) - 1)
        helpers = [self._pool.submit(work) for _ in range(most) if self._pool]
        work()
        for helper in helpers:
            if not helper.cancel():
                helper.result()
