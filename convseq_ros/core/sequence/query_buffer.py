# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rolling buffer of query frames, and their pair scores as far as they are known (III-A)."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from convseq_ros.config import Config
from convseq_ros.core.constants import constants
from convseq_ros.core.geometry.verification import Verification, verify
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.matcher import Features, Matcher
from convseq_ros.core.sequence.diagonals import diagonal, ONE_SESSION, sequence_scores, Values
from convseq_ros.core.types import Candidate, Descriptor, Indices, Row
import numpy as np

Coarse = Callable[[Descriptor, int], Row | None]  # takes in a frame, and how many are usable


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
    coarse: Row | None = None  # coarse scores (R,)
    rescored: set[int] = field(default_factory=set)  # references whose pair score is exact


class QueryBuffer:
    """
    Keeps the last frames, and scores each pair once; otherwise as for `sequence_scores`.

    `frame`, the newest one's number, goes on when emptied; `pairs_scored` counts since that frame.
    """

    def __init__(
        self, matcher: Matcher, partial: bool, bounds: SessionBounds = ONE_SESSION
    ) -> None:
        self.frame = self.pairs_scored = 0
        self._matcher, self._partial, self.bounds = matcher, partial, bounds
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

    def append(self, descriptor: Descriptor, usable: int, coarse: Coarse, most: int) -> None:
        """Add the newest frame, which may show so many references; keep so many frames at most."""
        features = self._matcher.extract(descriptor) if descriptor.informative else None
        shown: tuple[Any, ...] = ()
        if features is not None:
            shown = features, np.full(usable, np.nan, np.float32), coarse(descriptor, usable)
        self._keep(BufferedFrame(descriptor, *shown), most)

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
        shown = list(self._diagonals(count, ends, velocity))
        asked = [(features, met[np.isnan(row[met])]) for _, features, row, met in shown]
        found = self._matcher.scores_of(asked)
        for (_, _, row, _), (_, missing), scores in zip(shown, asked, found, strict=True):
            row[missing] = scores
            self.pairs_scored += len(missing)

    def unscored(self, count: int, ends: Indices, velocity: float = 1.0) -> Indices:
        """Return references on diagonals of so many frames that lack a pair score, each anew."""
        shown = self._diagonals(count, ends, velocity)
        missing = [met[np.isnan(row[met])] for _, _, row, met in shown]
        return np.concatenate([np.zeros(0, np.int64), *missing])

    def score_promising(self, count: int, ends: Indices, velocity: float = 1.0) -> None:
        """Score the newest half, if `partial`, of diagonals, and the rest of the better half."""
        newest = -(-count // 2) if self._partial else count
        self.score(newest, ends, velocity)
        scores = self.approximate_scores(min(newest, len(self)), ends, velocity)
        better = np.argsort(-scores, kind='stable')[: -(-len(ends) // 2)]
        self.score(count, ends[np.sort(better)], velocity)

    def approximate_scores(self, length: int, ends: Indices, velocity: float = 1.0) -> Values:
        """Return the `sequence_scores` (n,) of the newest frames, of the pairs that are scored."""
        return sequence_scores(self.rows[:length], velocity, ends, self._partial, self.bounds)

    def best_scores(self, length: int, ends: Indices, velocity: float = 1.0) -> Values:
        """Return scores that are exact for the 8 best at most, those within 0.02 of the best."""
        scores = self.approximate_scores(length, ends, velocity)
        if self._matcher.exact:
            return scores
        best = np.argsort(-scores, kind='stable')[: BUFFER.most_rescored]
        best = best[scores[best] >= scores.max(initial=-np.inf) - BUFFER.error]
        shown = list(self._diagonals(length, ends[best], velocity))
        rough = [
            np.array([each for each in met.tolist() if each not in one.rescored], np.int64)
            for one, _, _, met in shown
        ]
        asked = [(features, some) for (_, features, *_), some in zip(shown, rough, strict=True)]
        found = self._matcher.exact_scores_of(asked)
        for (one, _, row, _), some, exact in zip(shown, rough, found, strict=True):
            row[some] = exact
            one.rescored.update(some.tolist())
        return self.approximate_scores(length, ends, velocity)

    def field(self, candidate: Candidate | None) -> Values:
        """Return where regions of the newest frame lie in a candidate, (n, 5)."""
        features = self.newest.features
        if features is None or candidate is None or candidate.shift is None:
            return np.zeros((0, 5))
        return self._matcher.field(features, candidate.reference_index, candidate.shift)

    def verified(self, indices: Sequence[int]) -> dict[int, Verification]:
        """Return what geometry says of the newest frame and some references, if it is asked."""
        features = self.newest.features
        return {} if features is None else self._matcher.verified(features, indices)

    @property
    def verified_step(self) -> Verification | None:
        """What geometry says of the newest frame and the one before, if it is asked."""
        features = [one.features for one in self.outward[:2]]
        shown = [one.arranged for one in features if one and one.arranged]
        return verify(shown[0], shown[1], (0.0, 0.0)) if len(shown) == 2 else None

    def _keep(self, frame: BufferedFrame, most: int) -> None:
        self._frames = deque((*self._frames, frame), most)
        self.frame += 1
        self.pairs_scored = 0

    def _diagonals(
        self, count: int, ends: Indices, velocity: float
    ) -> Iterator[tuple[BufferedFrame, Features, Row, Indices]]:
        """Yield each newest frame that shows something, with the references that it meets."""
        firsts, stops = self.bounds.spans(ends)
        for step, one in zip(diagonal(count, velocity), self.outward, strict=False):
            if one.row is not None and one.features is not None:
                met = ends - step
                there = (met >= firsts) & (met < np.minimum(stops, len(one.row)))
                yield one, one.features, one.row, met[there]


def is_partial(config: Config) -> bool:
    """Return whether sequences count that lie partly off the map; never in the paper."""
    return config.matching.matching == 'coherent'
