# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What decides: one question, one complete answer."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from convseq_ros.config import Config
from convseq_ros.core.map.place import Place
from convseq_ros.core.sequence.query_buffer import QueryBuffer
from convseq_ros.core.types import Candidate, Candidates, Doubles, Flags, Frame, Reason
import numpy as np


@dataclass(frozen=True, eq=False, slots=True)
class Query:
    """A keyframe that shows something, with those before it."""

    frame: Frame
    buffer: QueryBuffer  # its newest frame is the query
    usable: int  # the first so many places may be matched, at least one
    session_start: int  # places from here on are of this very drive
    config: Config  # as it is now
    length: int | None  # k of the paper; None if that takes more frames than there are
    missing: int = 0  # keyframes that were dropped before it


@dataclass(frozen=True, slots=True)
class Answer:
    """What is decided about a query."""

    reason: Reason
    candidates: Candidates = ()  # best first
    length: int = 0  # frames matched together
    confidence: float | None = None  # probability that the best is right, if it is known
    implausible_m: float | None = None  # by how much odometry denies the best, if it does


def candidate(
    places: Sequence[Place], index: int, score: float, inliers: int | None = None
) -> Candidate:
    """Return a place as a candidate."""
    place = places[index]
    return Candidate(index, place.stamp_ns, score, inliers=inliers, session=place.session)


class Decider(Protocol):
    """Decides frame after frame: `PaperDecider`, as the paper does, or `BeliefDecider`."""

    def decide(self, query: Query) -> Answer:
        """Return what is known about the place that the newest frame shows."""

    def reset(self) -> None:
        """Forget the drive."""

    def share(self, other: object) -> None:
        """Have what odometry says of the matches of another camera's decider hold for both."""


def apart(scores: Doubles, count: int, near: Callable[[int], Flags]) -> list[int]:
    """Return where the best so many finite scores (n,) are, none `near` (n,) a better one."""
    left, found = np.isfinite(scores), list[int]()
    while len(found) < count and left.any():
        found.append(int(np.where(left, scores, -np.inf).argmax()))
        left &= ~near(found[-1])
    return found
