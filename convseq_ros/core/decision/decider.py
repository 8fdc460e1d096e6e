# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of the deciders: from a query to its candidates and a reason."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from convseq_ros.config import Config
from convseq_ros.core.map.place import Place
from convseq_ros.core.sequence.query_buffer import QueryBuffer
from convseq_ros.core.similarity.scorer import Features
from convseq_ros.core.types import Candidate, Candidates, Doubles, Flags, Frame, Indices, Reason
import numpy as np


@dataclass(frozen=True, eq=False, slots=True)
class Query:
    """An informative keyframe, with the keyframes before it."""

    frame: Frame
    features: Features  # of the frame
    buffer: QueryBuffer  # its newest frame is the query
    usable: int  # number of places, from the first, that may be matched; at least one
    session_start: int  # places from this index on are of the running session
    config: Config  # the current one; it may change between frames
    missing: int = 0  # number of keyframes that were dropped before this one
    drive_start: int = 0  # of the running session, or of one that ended a moment before it
    barred: Sequence[range] = ()  # places that may not be matched, since another lens took them

    def may_match(self, place: int) -> bool:
        """Return whether no other lens took a place."""
        return not any(place in part for part in self.barred)


@dataclass(frozen=True, slots=True)
class Answer:
    """The decision about a query."""

    reason: Reason
    candidates: Candidates = ()  # best first
    length: int = 0  # k: number of frames on which it rests
    confidence: float | None = None  # probability that the best is right, if it is known
    implausible_m: float | None = None  # distance of the best beyond what odometry allows
    pairs_scored: int = 0


def candidate(
    places: Sequence[Place], index: int, score: float, inliers: int | None = None
) -> Candidate:
    """Return a place as a candidate."""
    place = places[index]
    return Candidate(index, place.stamp_ns, score, inliers=inliers, session=place.session)


class Decider:
    """Decides frame by frame: `PaperDecider`, as the paper does, or `BeliefDecider`."""

    @property
    def odometry_jumps(self) -> int:
        """How many steps of odometry were left out, since no robot can have made them."""
        return 0

    def follow(self, frame: Frame, config: Config) -> None:
        """Take in the odometry of the next frame, also if it is no keyframe."""

    def decide(self, query: Query) -> Answer:
        """Return the places that the newest frame may show, and whether the best is a match."""
        raise NotImplementedError

    def reset(self) -> None:
        """Forget the drive."""

    def expect(self, places: Indices, weights: Doubles, earlier: int) -> None:
        """
        Look first at places (n,), ascending, by weights (n,) whose sum is 1, if there is a belief.

        `earlier` is the number of places of earlier drives.
        """

    def use_matches_of(self, other: object) -> None:
        """Use the matches and the odometry of the decider of another camera of the robot."""


def distinct_peaks(scores: Doubles, count: int, near: Callable[[int], Flags]) -> list[int]:
    """Return positions of the `count` best finite scores (n,), none `near` (n,) a better one."""
    left, peaks = np.isfinite(scores), list[int]()
    while len(peaks) < count and left.any():
        peaks.append(int(np.where(left, scores, -np.inf).argmax()))
        left &= ~near(peaks[-1])
    return peaks
