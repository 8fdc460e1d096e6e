# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The order of stamps: frames that come late, and clocks that jump back."""

from enum import Enum

_CLOCK_JUMP_NS = 1_000_000_000  # a frame that is late by more means that the clock jumped

Order = Enum('Order', ['NEXT', 'LATE', 'JUMPED_BACK'])  # of a stamp after the ones before


class StampOrder:
    """Distinguishes frames that come late from a clock that jumped back."""

    _last_ns: int | None = None

    def reset(self) -> None:
        self._last_ns = None

    def check(self, stamp_ns: int) -> Order:
        """Return the order of the next stamp, nanoseconds; a late one is then forgotten."""
        late_ns = 0 if self._last_ns is None else self._last_ns - stamp_ns
        if 0 < late_ns <= _CLOCK_JUMP_NS:
            return Order.LATE
        self._last_ns = stamp_ns
        return Order.JUMPED_BACK if late_ns > 0 else Order.NEXT


class AnyOrder(StampOrder):
    """Treats every frame as the next, whatever its stamp."""

    def check(self, _stamp_ns: int) -> Order:
        """Return NEXT."""
        return Order.NEXT
