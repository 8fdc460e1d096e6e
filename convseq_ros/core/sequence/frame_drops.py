# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many frames of a steady stream were dropped, by their stamps."""

from collections import deque
from dataclasses import dataclass
import statistics


@dataclass(frozen=True, slots=True)
class FrameDropConstants:
    """Of a steady stream; chosen by hand on recordings with known drops (docs/MATCHING.md)."""

    memory: int = 20  # intervals that are remembered
    fewest: int = 8  # intervals without which nothing is said
    tolerance: float = 0.25  # by which an interval may miss a multiple of the usual one
    steady_share: float = 0.8  # of the intervals that must be such multiples


FRAME_DROPS = FrameDropConstants()


class NoFrameDrops:
    """Stands in where nobody asks for dropped frames."""

    def reset(self) -> None: ...

    def update(self, _stamp_ns: int) -> int:
        return 0

    def update_keyframe(self) -> int:
        return 0


class FrameDropDetector(NoFrameDrops):
    """
    Knows the usual time between two frames, if there is one.

    Where the times are not multiples of the shortest usual one nothing counts as missing.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the frames so far."""
        self._last_ns: int | None = None
        self._intervals_ns: deque[int] = deque(maxlen=FRAME_DROPS.memory)
        self._frames = self._missing = 0
        self._stride = 1

    def update(self, stamp_ns: int) -> int:
        """Take in a frame; return how many are missing between it and the one before."""
        if self._last_ns is None:
            self._last_ns, self._frames = stamp_ns, 1
            return 0
        interval_ns, usual_ns = stamp_ns - self._last_ns, self._usual_ns()
        self._last_ns = stamp_ns
        if interval_ns > 0:
            self._intervals_ns.append(interval_ns)
        missing = max(0, round(interval_ns / usual_ns) - 1) if usual_ns else 0
        self._frames += 1
        self._missing += missing
        return missing

    def update_keyframe(self) -> int:
        """
        Take the newest frame as a keyframe; return how many keyframes are missing before it.

        As many frames count as one as there were from keyframe to keyframe the last time.
        """
        missing = self._missing // self._stride
        self._stride = max(1, self._frames)
        self._frames = self._missing = 0
        return missing

    def _usual_ns(self) -> float | None:
        if len(self._intervals_ns) < FRAME_DROPS.fewest:
            return None
        usual_ns = statistics.quantiles(self._intervals_ns, n=4)[0]
        steps = [interval_ns / usual_ns for interval_ns in self._intervals_ns]
        steady = sum(abs(step - max(1, round(step))) <= FRAME_DROPS.tolerance for step in steps)
        return usual_ns if steady >= FRAME_DROPS.steady_share * len(steps) else None
