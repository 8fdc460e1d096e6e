# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the node counts about itself."""

from collections import Counter
from dataclasses import dataclass, field
import time

from convseq_ros.core.types import Match


@dataclass(slots=True)
class Statistics:
    """
    Counts since the start; each is changed by one thread alone.

    Parameters
    ----------
    received : int
        Messages on the image topic.
    processed : int
        Frames that got an answer.
    unreadable : int
        Frames that could not be decoded.
    failed : int
        Frames that got no answer because of an error.
    unkept : int
        Times that what a map gained could not be written to its file.
    last_arrival_ns : int
        Monotonic time of the last message, or of the start.
    latency_ms, duration_ms : float
        Of the last frame: from its arrival to its answer, and the work alone.
    busy_ms : float
        The work on all frames together.

    """

    received: int = 0
    processed: int = 0
    unreadable: int = 0
    failed: int = 0
    unkept: int = 0
    last_arrival_ns: int = field(default_factory=time.monotonic_ns)
    last_match: Match | None = None
    latency_ms: float = 0.0
    duration_ms: float = 0.0
    busy_ms: float = 0.0
    reasons: Counter[str] = field(default_factory=Counter)

    def arrived(self, arrival_ns: int) -> None:
        """Count a message."""
        self.received += 1
        self.last_arrival_ns = arrival_ns

    def answered(self, match: Match, arrival_ns: int, duration_ms: float) -> None:
        """Count an answer."""
        self.processed += 1
        self.reasons[match.reason.value] += 1
        self.last_match = match
        self.duration_ms = duration_ms
        self.busy_ms += duration_ms
        self.latency_ms = (time.monotonic_ns() - arrival_ns) / 1e6
