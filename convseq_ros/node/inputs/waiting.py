# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An image waits for a message of another topic."""

from collections.abc import Callable
import threading

_VAIN_WAITS = 3


class Waiting:
    """Makes an image wait for another topic's message, unless three have waited in vain."""

    def __init__(self, wait_s: float) -> None:
        self.wait_s = wait_s
        self.changed = threading.Condition()
        self._in_vain = 0

    def configure(self, wait_s: float) -> None:
        """Wait so long from now on."""
        self.wait_s = wait_s

    def wait_until(self, has_come: Callable[[], bool]) -> None:
        """Wait until a message has come, at most `wait_s`; the caller holds `changed`."""
        if self._in_vain < _VAIN_WAITS and not self.changed.wait_for(has_come, self.wait_s):
            self._in_vain += 1

    def notify(self) -> None:
        """Wake up an image that waits; the caller holds `changed`."""
        self._in_vain = 0
        self.changed.notify()
