# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many frames of a steady stream went missing, by their stamps."""

from collections import deque
import statistics

_MEMORY = 20
_FEWEST = 8
_TOLERANCE = 0.25
_STEADY_SHARE = 0.8


class Pace:
    """
    Knows the usual time between two frames, if there is one.

    Where the times are not multiples of the shortest usual one nothing counts as missing.
    """

    def __init__(self) -> None:
        self._last_ns: int | None = None
        self._intervals_ns: deque[int] = deque(maxlen=_MEMORY)

        self._frames = self._lost = 0
        self._stride = 1

    def reset(self) -> None:
        """Forget the frames seen so far."""
        self._last_ns = None
        self._intervals_ns.clear()
        self._frames = self._lost = 0
        self._stride = 1

    def missing(self, stamp_ns: int) -> int:
        """Take note of a frame; return how many are missing between it and the one before."""
        if self._last_ns is None:
            self._last_ns = stamp_ns
            self._frames = 1
            return 0
        interval_ns = stamp_ns - self._last_ns
        self._last_ns = stamp_ns
        usual_ns = self._usual_ns()
        if interval_ns > 0:
            self._intervals_ns.append(interval_ns)
        lost = max(0, round(interval_ns / usual_ns) - 1) if usual_ns else 0
        self._frames += 1
        self._lost += lost
        return lost

    def missing_keyframes(self) -> int:
        """
        Take the newest frame as a keyframe; return how many are missing before it.

        As many frames count as one as there were from keyframe to keyframe the last time.
        """
        missing = self._lost // self._stride
        self._stride = max(1, self._frames)
        self._frames = self._lost = 0
        return missing

    def _usual_ns(self) -> float | None:
        if len(self._intervals_ns) < _FEWEST:
            return None
        usual_ns = statistics.quantiles(self._intervals_ns, n=4)[0]
        steps = [interval_ns / usual_ns for interval_ns in self._intervals_ns]
        steady = sum(abs(step - max(1, round(step))) <= _TOLERANCE for step in steps)
        return usual_ns if steady >= _STEADY_SHARE * len(steps) else None
