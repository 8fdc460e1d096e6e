# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rolling buffer of query frames, and their pair scores as far as they are known (III-A)."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from convseq_ros.core.matcher import Features, Matcher
from convseq_ros.core.sequence.diagonals import diagonal, Indices, Row, sequence_scores, Values
from convseq_ros.core.types import Candidate, Descriptor
import numpy as np


@dataclass(frozen=True, slots=True)
class BufferConstants:
    """Of the buffer; engineering, but for the error, which was measured."""

    longest_gap: int = 5  # missing frames that hold their places
    most_rescored: int = 8  # sequences
    error: float = 0.02  # of a score; ten times the largest that was seen, of single pairs


BUFFER = BufferConstants()


@dataclass(frozen=True, slots=True)
class BufferedFrame:
    """A frame of the buffer; its row fills as pairs are scored."""

    descriptor: Descriptor
    features: Features | None = None  # None if it shows nothing
    row: Row | None = None  # pair scores (R,), NaN where there is none
    coarse: Row | None = None  # coarse scores (R,)
    rescored: set[int] = field(default_factory=set)  # references whose pair score is exact


class QueryBuffer:
    """
    Keeps the last frames, and scores each pair of frame and reference once.

    If `partial`, sequences may leave the map, as `sequence_scores` says. `frame` is the number of
    the newest frame, which goes on when the buffer is emptied; `pairs_scored` counts since then.
    """

    def __init__(self, matcher: Matcher, partial: bool) -> None:
        self.frame = self.pairs_scored = 0
        self._matcher, self._partial = matcher, partial
        self._frames: deque[BufferedFrame] = deque()

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def newest(self) -> BufferedFrame:
        """The frame that came last."""
        return self._frames[-1]

    @property
    def outward(self) -> list[BufferedFrame]:
        """All frames, newest first."""
        return list(reversed(self._frames))

    @property
    def row(self) -> Row | None:
        """Pair scores of the newest frame, (R,), NaN where there is none; None if it has none."""
        return self._frames[-1].row if self._frames else None

    def reset(self) -> None:
        """Forget all frames."""
        self._frames.clear()

    def append(
        self,
        descriptor: Descriptor,
        usable: int,
        coarse: Callable[[Descriptor, int], Row | None],
        most: int,
    ) -> None:
        """
        Add the newest frame, which may show so many references, and keep so many frames at most.

        `coarse` takes in a frame that shows something, and returns its coarse scores.
        """
        features = self._matcher.extract(descriptor) if descriptor.informative else None
        frame = BufferedFrame(descriptor)
        if features is not None:
            row = np.full(usable, np.nan, np.float32)
            frame = BufferedFrame(descriptor, features, row, coarse(descriptor, usable))
        self._keep(frame, most)

    def hold_places(self, missing: int, blank: Descriptor, most: int) -> None:
        """Let frames that never came keep the diagonals straight; begin anew after a long gap."""
        if missing > BUFFER.longest_gap:
            self._frames.clear()
            self.frame += missing
            return
        for _ in range(missing):
            self._keep(BufferedFrame(blank), most)

    def score(self, count: int, ends: Indices, velocity: float = 1.0) -> None:
        """Score what is missing of so many newest frames on diagonals, by their ends (n,)."""
        lacking = [
            (row, features, met[np.isnan(row[met])])
            for _, features, row, met in _diagonals(self.outward[:count], ends, velocity)
        ]
        found = self._matcher.scores_of([(features, missing) for _, features, missing in lacking])
        for (row, _, missing), scores in zip(lacking, found, strict=True):
            row[missing] = scores
            self.pairs_scored += len(missing)

    def score_promising(self, count: int, ends: Indices, velocity: float = 1.0) -> None:
        """
        Score the newest half of some diagonals and, of the better half of them, the rest.

        All of all where sequences may not leave the map, and so lack no scores.
        """
        newest = -(-count // 2) if self._partial else count
        self.score(newest, ends, velocity)
        scores = self.approximate_scores(min(newest, len(self)), ends, velocity)
        better = np.argsort(-scores, kind='stable')[: -(-len(ends) // 2)]
        self.score(count, ends[np.sort(better)], velocity)

    def approximate_scores(self, length: int, ends: Indices, velocity: float = 1.0) -> Values:
        """Return the `sequence_scores` (n,) of the newest frames, of the pairs that are scored."""
        rows = [one.row for one in self.outward[:length]]
        return sequence_scores(rows, velocity, ends, partial=self._partial)

    def best_scores(self, length: int, ends: Indices, velocity: float = 1.0) -> Values:
        """
        Return `approximate_scores`, but exact for whatever may be the best.

        Where the kernel approximates, these are those within 0.02 of the best, and 8 at most.
        """
        scores = self.approximate_scores(length, ends, velocity)
        if self._matcher.exact:
            return scores
        best = np.argsort(-scores, kind='stable')[: BUFFER.most_rescored]
        best = best[scores[best] >= scores.max(initial=-np.inf) - BUFFER.error]
        for one, features, row, met in _diagonals(self.outward[:length], ends[best], velocity):
            rough = np.array([index for index in met if index not in one.rescored], np.int64)
            row[rough] = self._matcher.exact_scores(features, rough)
            one.rescored.update(rough.tolist())
        return self.approximate_scores(length, ends, velocity)

    def inliers(self, candidate: Candidate | None) -> Values:
        """Return the regions that moved from the newest frame to a candidate, (n, 4)."""
        features = self.newest.features
        if features is None or candidate is None or candidate.shift is None:
            return np.zeros((0, 4))
        return self._matcher.inliers(features, candidate.reference_index, candidate.shift)

    def _keep(self, frame: BufferedFrame, most: int) -> None:
        self._frames.append(frame)
        self.frame += 1
        self.pairs_scored = 0
        while len(self._frames) > most:
            self._frames.popleft()


def _diagonals(
    window: Sequence[BufferedFrame], ends: Indices, velocity: float
) -> Iterator[tuple[BufferedFrame, Features, Row, Indices]]:
    """Yield each frame that shows something, with the references that it meets."""
    for step, one in zip(diagonal(len(window), velocity), window, strict=True):
        if one.row is not None and one.features is not None:
            met = ends - step
            yield one, one.features, one.row, met[(met >= 0) & (met < len(one.row))]
