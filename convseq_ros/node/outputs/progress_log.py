# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node's log of its progress: frames that came, matched and were dropped."""

from collections import Counter
from collections.abc import Callable, Mapping
import time

from convseq_ros.node.outputs.counters import Counters
from convseq_ros.node.qos import steady_timer
from rclpy.node import Node

_PERIOD_S = 1.0
_LOG_S, _WARN_S = 10.0, 5.0
_REMEDIES = {
    'queue_size': 'found the queue full (queue_size)',
    'memory': 'found no memory left for the queue (256 MB)',
    'max_wait_s': 'had waited longer than max_wait_s',
    'middleware': 'were lost by the middleware (config/fastdds_large_images.xml)',
}


class ProgressLog:
    """Logs a summary every 10 s and at the end, and dropped frames by cause every 5 s."""

    def __init__(
        self, node: Node, counters: Counters, drops: Callable[[], Mapping[str, int]]
    ) -> None:
        self._logger = node.get_logger()
        self._counters = counters
        self._drops = drops
        self._logged = self._warned = time.monotonic()
        self._before = self._counts()
        self._dropped_before: Counter[str] = Counter()
        self._timer = steady_timer(node, _PERIOD_S, self._tick)

    def finish(self, waiting: int) -> None:
        """Log a summary since the start, and how many frames still wait, if any arrived."""
        self._warn()
        if self._counters.received:
            left = f'; {waiting} still waited' if waiting else ''
            self._logger.info(f'at the end: {self._summary((0, 0, 0, 0.0))}{left}')

    def _tick(self) -> None:
        now = time.monotonic()
        if now - self._warned >= _WARN_S or not self._dropped_before:
            self._warn()
        if now - self._logged >= _LOG_S:
            if self._counters.received > self._before[0]:
                self._logger.info(f'in {now - self._logged:.0f} s: {self._summary(self._before)}')
            self._logged, self._before = now, self._counts()

    def _counts(self) -> tuple[int, int, int, float]:
        now = self._counters
        return now.received, now.processed, now.reasons['accepted'], now.busy_ms

    def _summary(self, before: tuple[int, int, int, float]) -> str:
        now = self._counts()
        received, processed, accepted = (now[at] - before[at] for at in range(3))
        spent_ms = (now[3] - before[3]) / max(processed, 1)
        return (
            f'{received} frames came, {processed} processed, {accepted} accepted, '
            f'{sum(self._drops().values())} dropped since the start; {spent_ms:.1f} ms a frame'
        )

    def _warn(self) -> None:
        drops = Counter(self._drops())
        new = drops - self._dropped_before
        if not new:
            return
        causes = ', '.join(f'{count} {_REMEDIES[cause]}' for cause, count in new.items())
        self._logger.warning(
            f'{new.total()} frames dropped, {drops.total()} of '
            f'{self._counters.received + drops["middleware"]} since the start: {causes}. Send '
            'fewer, or raise keyframe_interval_s'
        )
        self._warned, self._dropped_before = time.monotonic(), drops
