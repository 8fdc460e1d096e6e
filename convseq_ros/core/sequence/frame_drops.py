# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many frames of a steady stream were dropped, by their stamps."""

from collections import deque
import statistics

from convseq_ros.core.constants import constants


@constants
class FRAME_DROPS:
    """Of a steady stream; chosen by hand on recordings with known drops (docs/MATCHING.md)."""

    memory: int = 20  # intervals that are remembered
    fewest: int = 8  # intervals without which nothing is said
    tolerance: float = 0.25  # by which an interval may miss a multiple of the usual one
    steady_share: float = 0.8  # of the intervals that must be such multiples


class FrameDropDetector:
    """
    Knows the usual time between two frames, if most times are multiples of a short one.

    With a `memory` of fewer than 8 intervals nothing is said: no frame is missing.
    """

    def __init__(self, memory: int = FRAME_DROPS.memory) -> None:
        self._memory = memory
        self.reset()

    def reset(self) -> None:
        self._last_ns: int | None = None
        self._intervals_ns: deque[int] = deque(maxlen=self._memory)
        self._frames, self._missing, self._stride = 0, 0, 1

    def update(self, stamp_ns: int) -> int:
        """Take in a frame; return how many are missing between it and the one before."""
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

    def update_keyframe(self) -> int:
        """Take the newest frame as a keyframe; return how many are missing, as far apart as it."""
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
