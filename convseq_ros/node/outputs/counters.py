# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node's counters."""

from collections import Counter
from dataclasses import dataclass, field
import time

from convseq_ros.core.types import Match


@dataclass(slots=True)
class Counters:
    """Counts since the start; each is changed by one thread alone."""

    received: int = 0  # messages on the image topic
    processed: int = 0  # frames that got an answer
    unreadable: int = 0  # frames that could not be decoded
    failed: int = 0  # frames that got no answer because of an error
    write_failures: int = 0  # times that new places could not be written to the map file
    last_match: Match | None = None
    latency_ms: float = 0.0  # of the last frame, from its arrival to its answer
    duration_ms: float = 0.0  # of the last frame, without waiting
    busy_ms: float = 0.0  # the work on all frames together
    reasons: Counter[str] = field(default_factory=Counter)

    def answered(self, match: Match, arrival_ns: int, duration_ms: float) -> None:
        self.processed += 1
        self.reasons[match.reason.value] += 1
        self.last_match = match
        self.duration_ms = duration_ms
        self.busy_ms += duration_ms
        self.latency_ms = (time.monotonic_ns() - arrival_ns) / 1e6
