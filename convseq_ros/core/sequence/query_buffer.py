# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rolling buffer of query frames and their pair scores (III-A)."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from convseq_ros.core.graph.session_bounds import SessionBounds
from convseq_ros.core.sequence.diagonals import ONE_SESSION, sequence_scores, Values
from convseq_ros.core.similarity.scorer import Features, Scorer
from convseq_ros.core.types import constants, Descriptor, Indices, Row
import numpy as np


@constants
class BUFFER:
    """Limits of the buffer; engineering."""

    longest_gap: int = 5  # missing frames; after more the buffer is emptied


@dataclass(frozen=True, slots=True)
class BufferedFrame:
    """A frame of the buffer; its row is filled in as pairs are scored."""

    descriptor: Descriptor
    features: Features | None = None  # None if it is not informative
    row: Row | None = None  # pair scores (R,), NaN where not scored
    evidence: float = 0.0  # log ratio, at least 0, by which it speaks for the likeliest place


class QueryBuffer:
    """Keeps the last frames, newest first, and scores each pair once."""

    def __init__(
        self,
        matcher: Scorer,
        bounds: SessionBounds = ONE_SESSION,
        frames: Iterable[BufferedFrame] = (),
    ) -> None:
        self._matcher, self.bounds, self.frames = matcher, bounds, [*frames]

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def newest(self) -> BufferedFrame:
        return self.frames[0]

    @property
    def descriptors(self) -> list[Descriptor]:
        """The descriptors of all frames, newest first."""
        return [frame.descriptor for frame in self.frames]

    @property
    def rows(self) -> list[Row | None]:
        """The pair scores of all frames, newest first."""
        return [frame.row for frame in self.frames]

    def reset(self) -> None:
        self.frames.clear()

    def append(self, descriptor: Descriptor, usable: int, capacity: int) -> None:
        """Add the newest frame, which may match the first `usable` references."""
        features = self._matcher.extract(descriptor) if descriptor.informative else None
        row = None if features is None else np.full(usable, np.nan, np.float32)
        self._keep(BufferedFrame(descriptor, features, row), capacity)

    def add_empty(self, missing: int, blank: Descriptor, capacity: int) -> None:
        """Add empty slots for missing frames, so that diagonals stay straight; or clear all."""
        if missing > BUFFER.longest_gap:
            self.frames.clear()
            return
        for _ in range(missing):
            self._keep(BufferedFrame(blank), capacity)

    def with_regions_of_newest(self, count: int) -> 'QueryBuffer':
        """Return the `count` newest frames with the newest's salient regions, to be scored."""
        salient, shared = self.newest.descriptor.salient, [self.newest]
        for frame in self.frames[1:count]:
            if frame.row is not None:
                descriptor = replace(frame.descriptor, salient=salient)
                row = np.full(len(frame.row), np.nan, np.float32)
                frame = BufferedFrame(descriptor, self._matcher.extract(descriptor), row)
            shared.append(frame)
        return QueryBuffer(self._matcher, self.bounds, shared)

    def score(self, count: int, ends: Indices) -> int:
        """
        Score the pairs of the `count` newest frames on diagonals that end at `ends` (n,).

        Return how many pairs were scored.
        """
        frames = list(self._diagonals(count, ends))
        requests = [(features, met[np.isnan(row[met])]) for _, features, row, met in frames]
        results = self._matcher.scores_of(requests)
        for (_, _, row, _), (_, missing), scores in zip(frames, requests, results, strict=True):
            row[missing] = scores
        return sum(len(missing) for _, missing in requests)

    def best_scores(self, length: int, ends: Indices) -> Values:
        """Return `sequence_scores` (n,)."""
        return sequence_scores(self.rows[:length], ends=ends, bounds=self.bounds)

    def note(self, row: Row, evidence: float) -> None:
        """Note the pair scores (R,) of the newest frame, found elsewhere, and its evidence."""
        self.frames[0] = replace(self.newest, row=row, evidence=evidence)

    def _keep(self, frame: BufferedFrame, capacity: int) -> None:
        self.frames = [frame, *self.frames[: capacity - 1]]

    def _diagonals(
        self, count: int, ends: Indices
    ) -> Iterator[tuple[BufferedFrame, Features, Row, Indices]]:
        """Yield the `count` newest frames that are informative, with their references."""
        firsts, stops = self.bounds.spans(ends)
        for age, frame in enumerate(self.frames[:count]):
            if frame.row is not None and frame.features is not None:
                met = ends - age
                is_inside = (met >= firsts) & (met < np.minimum(stops, len(frame.row)))
                yield frame, frame.features, frame.row, met[is_inside]
