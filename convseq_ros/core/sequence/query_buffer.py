# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The rolling buffer of query frames and their pair scores (III-A).

Sequence scores are means of pair scores along diagonals (III-G). Frames say how new they are, and
how much they tell of the likeliest place.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from convseq_ros.core.graph.neighbourhood import SessionBounds
from convseq_ros.core.similarity.scorer import Features, Scorer
from convseq_ros.core.types import constants, Descriptor, Indices, Row
import numpy as np
import numpy.typing as npt

Rows = Sequence[Row | None]  # newest first; None for an uninformative frame
Values = npt.NDArray[Any]
ONE_SESSION = SessionBounds()


def diagonal(length: int, velocity: float = 1.0) -> list[int]:
    """Return how many places before its end a diagonal meets each frame, newest first."""
    steps = [int(offset * abs(velocity) + 0.5) for offset in range(length)]
    return steps if velocity > 0 else [-step for step in steps]


def sequence_scores(
    rows: Rows, ends: Indices | None = None, bounds: SessionBounds = ONE_SESSION
) -> Values:
    """
    Return the scores of a sequence of k frames at each reference, (R,), or at `ends`, (n,).

    A score is the mean of the pair scores along a diagonal (III-G). It is -inf if the diagonal
    leaves its session, the newest pair is not scored, or fewer than half of the pairs are scored.
    `ends` are ascending. Raises ValueError if the newest frame has no scores. Older rows may be
    shorter.
    """
    if rows[0] is None:
        raise ValueError('the newest frame of a sequence must be informative')
    references = np.arange(len(rows[0]))
    ends = references if ends is None else ends
    dtype: Any = np.float32 if len(ends) == len(references) else np.float64
    firsts, stops = bounds.spans(ends)
    total, known = np.zeros(len(ends), dtype), np.zeros(len(ends), dtype)
    scored = ends - len(rows) + 1 >= firsts
    for age, row in enumerate(rows):
        if row is None or not len(row):
            continue
        met = ends - age
        pairs = row.take(met, mode='clip')
        is_known = (met >= firsts) & (met < np.minimum(stops, len(row))) & np.isfinite(pairs)
        total += np.where(is_known, pairs, np.float32(0))
        known += is_known
        if not age:
            scored &= is_known
    scored &= 2 * known >= len(rows)
    return np.divide(total, known, out=np.full(len(ends), -np.inf, dtype), where=scored)


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


@constants
class EVIDENCE:
    """Which frames of the buffer count."""

    carried: float = 0.9  # share of the evidence that the k newest frames carry; engineering


def novelty(frames: Sequence[BufferedFrame]) -> float:
    """
    Return how new the newest of frames is, in [0, 1]: 1 if its cosine with the last is at most .5.

    Frames are newest first. One after an empty slot, or without cells, is new.
    """
    images = [one.features.packed for one in frames[:2] if one.features and one.features.packed]
    vectors = [image.rows.view(np.int8).ravel().astype(np.float32) for image in images]
    if len(vectors) < 2 or not (
        lengths := float(np.linalg.norm(vectors[0]) * np.linalg.norm(vectors[1]))
    ):
        return 1.0
    return min(1.0, max(0.0, 2 - 2 * float(vectors[0] @ vectors[1]) / lengths))


def evidence_length(frames: Sequence[BufferedFrame]) -> int:
    """Return how many of the newest frames, k, carry nine tenths of the frames' evidence."""
    carried = np.cumsum([frame.evidence for frame in frames])
    return 1 + int(np.searchsorted(carried, EVIDENCE.carried * carried[-1]))
