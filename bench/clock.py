# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Times of several sides, taken in turn, so that a busy machine slows them all alike."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import math
import time

import numpy as np

_SAMPLE_MS = 25.0
_LONG_MS = 1000.0


@dataclass(frozen=True, slots=True)
class Times:
    """
    How long one side took.

    Parameters
    ----------
    samples_ms : tuple of float
        Milliseconds, round by round.

    """

    samples_ms: tuple[float, ...]

    @property
    def median(self) -> float:
        """Milliseconds."""
        return float(np.median(self.samples_ms))

    def faster_than(self, other: 'Times') -> float:
        """Return how many times faster than another side this one is, over the same rounds."""
        pairs = zip(self.samples_ms, other.samples_ms, strict=True)
        return float(np.median([theirs / own for own, theirs in pairs]))


def in_turn(
    sides: Mapping[str, Callable[[], object]],
    budget_s: float,
    fewest: int = 3,
    most: int = 200,
    sample_ms: float = _SAMPLE_MS,
    rest_s: float = 0.0,
) -> dict[str, Times]:
    """
    Return the times of some sides, each called once before it counts.

    Parameters
    ----------
    sides : mapping from str to callable
        Who does the work.
    budget_s : float
        Seconds for all of them together, if `fewest` rounds fit in.
    fewest, most : int
        Rounds.
    sample_ms : float
        Short work is repeated for so long. Were samples shorter than what a busy system gives to a
        process at once, those of a fast side would suffer less from others than those of a slow
        one.
    rest_s : float
        Seconds between two sides: threads of BLAS wait for more work by spinning for a while, and
        take a core from whoever comes next.

    """
    repeats, expected_ms = {}, 0.0
    for name, work in sides.items():
        once_ms = _elapsed_ms(work, 1)
        if once_ms < _LONG_MS:
            once_ms = _elapsed_ms(work, 1)
        repeats[name] = max(1, math.ceil(sample_ms / max(once_ms, 1e-4)))
        expected_ms += once_ms * repeats[name]
    rounds = min(most, max(fewest, int(1e3 * budget_s / expected_ms)))
    samples: dict[str, list[float]] = {name: [] for name in sides}
    order = list(sides)
    for _ in range(rounds):
        for name in order:
            time.sleep(rest_s)
            samples[name].append(_elapsed_ms(sides[name], repeats[name]))
        order = [*order[1:], order[0]]
    return {name: Times(tuple(own)) for name, own in samples.items()}


def _elapsed_ms(work: Callable[[], object], repeats: int) -> float:
    start_ns = time.perf_counter_ns()
    for _ in range(repeats):
        work()
    return (time.perf_counter_ns() - start_ns) / 1e6 / repeats
