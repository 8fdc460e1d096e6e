# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Dropped frames: gaps between the stamps of a steady stream show how many are missing."""

from collections import deque
import statistics

from convseq_ros.core.types import constants


@constants
class FRAME_DROPS:
    """A steady stream; engineering, tried on recordings with known drops."""

    memory: int = 20  # number of recent intervals in use
    fewest: int = 8  # smallest number of intervals; with fewer, no drops are reported
    tolerance: float = 0.25  # by which a multiple of the usual interval may be off
    steady_share: float = 0.8  # smallest share of intervals that are multiples


class FrameDropDetector:
    """
    Counts dropped frames, if most intervals between frames are multiples of a short one.

    With a `memory` of fewer than 8 intervals, no frame is ever reported as dropped.
    """

    def __init__(self, memory: int = FRAME_DROPS.memory) -> None:
        self._memory = memory
        self.reset()

    def reset(self) -> None:
        self._last_ns: int | None = None
        self._intervals_ns: deque[int] = deque(maxlen=self._memory)
        self._frames, self._missing, self._stride = 0, 0, 1

    def observe(self, stamp_ns: int) -> int:
        """Return how many frames were dropped between the frame before and this one."""
        missing, usual_ns = 0, self._usual_ns()
        if self._last_ns is not None:
            interval_ns = stamp_ns - self._last_ns
            if interval_ns > 0:
                self._intervals_ns.append(interval_ns)
            missing = max(0, round(interval_ns / usual_ns) - 1) if usual_ns else 0
        self._last_ns = stamp_ns
        self._frames += 1
        self._missing += missing
        return missing

    def observe_keyframe(self) -> int:
        """Make the newest frame a keyframe; return how many keyframes were dropped before it."""
        missing = self._missing // self._stride
        self._frames, self._missing, self._stride = 0, 0, max(1, self._frames)
        return missing

    def _usual_ns(self) -> float | None:
        if len(self._intervals_ns) < FRAME_DROPS.fewest:
            return None
        usual_ns = statistics.quantiles(self._intervals_ns, n=4)[0]
        steps = [interval_ns / usual_ns for interval_ns in self._intervals_ns]
        steady = sum(abs(step - max(1, round(step))) <= FRAME_DROPS.tolerance for step in steps)
        return usual_ns if steady >= FRAME_DROPS.steady_share * len(steps) else None
