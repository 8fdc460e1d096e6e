# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What wakes a thread."""

from contextlib import suppress
from queue import Empty, SimpleQueue


class Bell:
    """
    Wakes a thread that waits for it; rings in between are one.

    Unlike an Event it leaves no lock behind if a signal's exception, such as KeyboardInterrupt,
    is raised in `ring`.
    """

    def __init__(self) -> None:
        self._rings: SimpleQueue[None] = SimpleQueue()
        self._is_over = False

    def ring(self) -> None:
        """Wake the thread now, or when it waits next."""
        if self._rings.empty():
            self._rings.put(None)

    def end(self) -> None:
        """Wake the thread for the last time."""
        self._is_over = True
        self._rings.put(None)

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for a ring, or for a time; return False after the last one."""
        with suppress(Empty):
            self._rings.get(timeout=timeout_s)
            while True:
                self._rings.get_nowait()
        return not self._is_over
