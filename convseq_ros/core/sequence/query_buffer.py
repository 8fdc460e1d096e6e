# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rolling buffer of query frames, and their pair scores as far as they are known (III-A)."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from convseq_ros.core.geometry.verification import Verification, verify
from convseq_ros.core.graph.links import SessionBounds
from convseq_ros.core.matcher import Features, Matcher
from convseq_ros.core.sequence.diagonals import ONE_SESSION, sequence_scores, Values
from convseq_ros.core.types import Candidate, constants, Descriptor, Indices, Row
import numpy as np


@constants
class BUFFER:
    """Of the buffer; engineering, but for the error, which was measured."""

    longest_gap: int = 5  # missing frames that hold their places
    most_rescored: int = 8  # sequences
    error: float = 0.02  # of a score; ten times the largest that was seen, of single pairs


@dataclass(frozen=True, slots=True)
class BufferedFrame:
    """A frame of the buffer; its row fills as pairs are scored."""

    descriptor: Descriptor
    features: Features | None = None  # None if it shows nothing
    row: Row | None = None  # pair scores (R,), NaN where there is none yet
    rescored: set[int] = field(default_factory=set)  # references whose pair score is exact
    verified: dict[int, Verification] = field(default_factory=dict)  # by reference
    novelty: float = 1.0  # see `QueryBuffer.novelty`


class QueryBuffer:
    """
    Keeps the last frames, and scores each pair once; otherwise as for `sequence_scores`.

    `pairs_scored` counts since the newest frame.
    """

    def __init__(self, matcher: Matcher, bounds: SessionBounds = ONE_SESSION) -> None:
        self._matcher, self.bounds, self.pairs_scored = matcher, bounds, 0
        self._frames: deque[BufferedFrame] = deque()

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def newest(self) -> BufferedFrame:
        return self._frames[-1]

    @property
    def outward(self) -> list[BufferedFrame]:
        """All frames, newest first."""
        return list(reversed(self._frames))

    @property
    def descriptors(self) -> list[Descriptor]:
        """What all frames show, newest first."""
        return [one.descriptor for one in self.outward]

    @property
    def row(self) -> Row | None:
        """Pair scores of the newest frame, (R,), NaN where there is none; None if it has none."""
        return self._frames[-1].row if self._frames else None

    @property
    def rows(self) -> list[Row | None]:
        """The same of all frames, newest first."""
        return [one.row for one in self.outward]

    def reset(self) -> None:
        self._frames.clear()

    def append(self, descriptor: Descriptor, usable: int, most: int) -> None:
        """Add the newest frame, which may show so many references; keep so many frames at most."""
        features = self._matcher.extract(descriptor) if descriptor.informative else None
        row = None if features is None else np.full(usable, np.nan, np.float32)
        before = self._frames[-1].features if self._frames else None
        new = _novelty(features, before)
        self._keep(BufferedFrame(descriptor, features, row, novelty=new), most)

    def hold_places(self, missing: int, blank: Descriptor, most: int) -> None:
        """Let frames that never came keep the diagonals straight; begin anew after a long gap."""
        if missing > BUFFER.longest_gap:
            self._frames.clear()
            return
        for _ in range(missing):
            self._keep(BufferedFrame(blank), most)

    def score(self, count: int, ends: Indices) -> None:
        """Score what is missing of so many newest frames on diagonals, by their ends (n,)."""
        shown = list(self._diagonals(count, ends))
        asked = [(features, met[np.isnan(row[met])]) for _, features, row, met in shown]
        found = self._matcher.scores_of(asked)
        for (_, _, row, _), (_, missing), scores in zip(shown, asked, found, strict=True):
            row[missing] = scores
            self.pairs_scored += len(missing)

    def rough_scores(self, ends: Indices) -> Row | None:
        """Return rough pair scores (n,) of the newest frame, NaN where nothing is shown."""
        features = self.newest.features
        return None if features is None else self._matcher.rough_scores(features, ends)

    def best_scores(self, length: int, ends: Indices) -> Values:
        """Return `sequence_scores` (n,), exact for the 8 best within 0.02 of the best."""
        scores = sequence_scores(self.rows[:length], ends=ends, bounds=self.bounds)
        if self._matcher.exact:
            return scores
        best = np.argsort(-scores, kind='stable')[: BUFFER.most_rescored]
        best = best[scores[best] >= scores.max(initial=-np.inf) - BUFFER.error]
        shown = list(self._diagonals(length, ends[best]))
        rough = [
            np.array([each for each in met.tolist() if each not in one.rescored], np.int64)
            for one, _, _, met in shown
        ]
        asked = [(features, some) for (_, features, *_), some in zip(shown, rough, strict=True)]
        found = self._matcher.exact_scores_of(asked)
        for (one, _, row, _), some, exact in zip(shown, rough, found, strict=True):
            row[some] = exact
            one.rescored.update(some.tolist())
        return sequence_scores(self.rows[:length], ends=ends, bounds=self.bounds)

    def field(self, candidate: Candidate | None) -> Values:
        """Return where regions of the newest frame lie in a candidate, (n, 5)."""
        features = self.newest.features
        if features is None or candidate is None or candidate.shift is None:
            return np.zeros((0, 5))
        return self._matcher.field(features, candidate.reference_index, candidate.shift)

    def verified(self, indices: Sequence[int]) -> dict[int, Verification]:
        """Return what geometry says of the newest frame and some references, if it is asked."""
        newest = self.newest
        if newest.features is not None:
            missing = [one for one in indices if one not in newest.verified]
            newest.verified.update(self._matcher.verified(newest.features, missing))
        return {one: newest.verified[one] for one in indices if one in newest.verified}

    @property
    def verified_step(self) -> Verification | None:
        """What geometry says of the newest frame and the one before, if it is asked."""
        features = [one.features for one in self.outward[:2]]
        shown = [one.arranged for one in features if one and one.arranged]
        return verify(shown[0], shown[1:], [(0.0, 0.0)])[0] if len(shown) == 2 else None

    @property
    def novelty(self) -> float:
        """How new the newest frame is, in [0, 1]: 1 up to a cosine of 0.5 with the last."""
        return self.newest.novelty

    def _keep(self, frame: BufferedFrame, most: int) -> None:
        self._frames = deque((*self._frames, frame), most)
        self.pairs_scored = 0

    def _diagonals(
        self, count: int, ends: Indices
    ) -> Iterator[tuple[BufferedFrame, Features, Row, Indices]]:
        """Yield each newest frame that shows something, with the references that it meets."""
        firsts, stops = self.bounds.spans(ends)
        for step, one in enumerate(self.outward[:count]):
            if one.row is not None and one.features is not None:
                met = ends - step
                there = (met >= firsts) & (met < np.minimum(stops, len(one.row)))
                yield one, one.features, one.row, met[there]


def _novelty(features: Features | None, before: Features | None) -> float:
    arranged = [one.arranged for one in (features, before) if one and one.arranged]
    shown = [one.rows.view(np.int8).ravel().astype(np.float32) for one in arranged]
    if len(shown) < 2 or not (
        lengths := float(np.linalg.norm(shown[0]) * np.linalg.norm(shown[1]))
    ):
        return 1.0
    return min(1.0, max(0.0, 2 - 2 * float(shown[0] @ shown[1]) / lengths))
