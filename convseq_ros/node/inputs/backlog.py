# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is heard before there is something to take it in."""

from collections.abc import Callable
from threading import Lock
import time
from typing import Any

from convseq_ros.errors import with_traceback

_Heard = tuple[Callable[..., None], tuple[Any, ...]]


class Backlog:
    """
    Keeps what subscriptions hear until it is taken in, in order; from then on nothing waits.

    Without `is_waiting` nothing ever does. `since_s` is the monotonic time since which something
    that matters waits; 0 if nothing does.
    """

    def __init__(self, logger: Any, is_waiting: bool) -> None:
        self._logger, self._lock, self.since_s = logger, Lock(), 0.0
        self._heard: list[_Heard] | None = [] if is_waiting else None

    @property
    def is_waiting(self) -> bool:
        """Whether what is heard waits."""
        return self._heard is not None

    def before(self, take: Callable[..., None], matters: bool = False) -> Callable[..., None]:
        """Return what hears in place of `take`, which is called now or later."""

        def hear(*heard: Any) -> None:
            with self._lock:
                if self._heard is not None:
                    self._heard.append((take, heard))
                    if matters:
                        self.since_s = self.since_s or time.monotonic()
                    return
            take(*heard)

        return hear

    def take_in(self) -> None:
        """Take in what was heard, and log what cannot be, as the executor does."""
        while waiting := self._next():
            for take, heard in waiting:
                try:
                    take(*heard)
                except Exception as error:
                    self._logger.error(with_traceback(error))
        self.since_s = 0.0

    def _next(self) -> list[_Heard]:
        """Return what was heard since the last call; when that is nothing, nothing waits again."""
        with self._lock:
            heard, self._heard = self._heard or [], [] if self._heard else None
        return heard
