# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The rolling buffer of query frames, and their pair scores as far as they are known (III-A).

How many of them are matched together (III-E, F), and what their diagonals along a map sum up to.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from statistics import fmean
from typing import Any

from convseq_ros.config import SequenceConfig
from convseq_ros.core.geometry.verification import Verification, verify
from convseq_ros.core.graph.links import SessionBounds
from convseq_ros.core.matcher import Features, Matcher
from convseq_ros.core.types import Candidate, constants, Descriptor, Indices, Row
import numpy as np
import numpy.typing as npt

Rows = Sequence[Row | None]  # newest first; None for an uninformative frame
Values = npt.NDArray[Any]
ONE_SESSION = SessionBounds()


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

    `frames` are newest first; `pairs_scored` counts since the newest one.
    """

    def __init__(self, matcher: Matcher, bounds: SessionBounds = ONE_SESSION) -> None:
        self._matcher, self.bounds, self.pairs_scored = matcher, bounds, 0
        self.frames: list[BufferedFrame] = []

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def newest(self) -> BufferedFrame:
        return self.frames[0]

    @property
    def descriptors(self) -> list[Descriptor]:
        """What all frames show, newest first."""
        return [one.descriptor for one in self.frames]

    @property
    def row(self) -> Row | None:
        """Pair scores of the newest frame, (R,), NaN where there is none; None if it has none."""
        return self.frames[0].row if self.frames else None

    @property
    def rows(self) -> list[Row | None]:
        """The same of all frames, newest first."""
        return [one.row for one in self.frames]

    def reset(self) -> None:
        self.frames.clear()

    def append(self, descriptor: Descriptor, usable: int, most: int) -> None:
        """Add the newest frame, which may show so many references; keep so many frames at most."""
        features = self._matcher.extract(descriptor) if descriptor.informative else None
        row = None if features is None else np.full(usable, np.nan, np.float32)
        new = _novelty(features, self.frames[0].features if self.frames else None)
        self._keep(BufferedFrame(descriptor, features, row, novelty=new), most)

    def hold_places(self, missing: int, blank: Descriptor, most: int) -> None:
        """Let frames that never came keep the diagonals straight; begin anew after a long gap."""
        if missing > BUFFER.longest_gap:
            self.frames.clear()
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
        features = [one.features for one in self.frames[:2]]
        shown = [one.arranged for one in features if one and one.arranged]
        return verify(shown[0], shown[1:], [(0.0, 0.0)])[0] if len(shown) == 2 else None

    @property
    def novelty(self) -> float:
        """How new the newest frame is, in [0, 1]: 1 up to a cosine of 0.5 with the last."""
        return self.newest.novelty

    def _keep(self, frame: BufferedFrame, most: int) -> None:
        self.frames = [frame, *self.frames[: most - 1]]
        self.pairs_scored = 0

    def _diagonals(
        self, count: int, ends: Indices
    ) -> Iterator[tuple[BufferedFrame, Features, Row, Indices]]:
        """Yield each newest frame that shows something, with the references that it meets."""
        firsts, stops = self.bounds.spans(ends)
        for step, one in enumerate(self.frames[:count]):
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


def choose_length(
    outward: Sequence[Descriptor],
    similarity: Callable[[Descriptor, Descriptor, float], float],
    config: SequenceConfig,
) -> int | None:
    """
    Return the length k of the sequence of frames outward from the first, the informative anchor.

    It grows while its outermost frame still overlaps the anchor (little information gain), by
    their pair score in [0, 1], then while it holds too little entropy. None is returned if that
    takes more frames than there are. `similarity` is told against what a score is compared.

    Notes
    -----
    With the following departures from the paper: (1) information gain is read as the released
    script does, `similarity >= overlap_threshold` extends; (2) the shortest chosen length is 2;
    (3) online, the anchor is the newest frame and the sequence reads into the past (the paper's
    anchor is the oldest frame and needs up to 24 future ones); (4) uninformative frames are passed
    over.

    """

    def overlaps(length: int) -> bool:
        other, least = outward[length - 1], config.overlap_threshold
        return not other.informative or similarity(outward[0], other, least) >= least

    available, length = len(outward), config.fixed_length or config.min_length
    if not config.fixed_length:
        while length < config.max_overlap_length and length <= available and overlaps(length):
            length += 1
        entropies = [one.entropy for one in outward[:length] if one.informative]
        while length < config.max_length and length <= available:
            if fmean(entropies) > config.entropy_threshold:
                break
            entropies += [one.entropy for one in outward[length : length + 1] if one.informative]
            length += 1
    return length if length <= available else None


def diagonal(length: int, velocity: float = 1.0) -> list[int]:
    """Return how far before its end, negative if after, a diagonal meets frames, newest first."""
    steps = [int(offset * abs(velocity) + 0.5) for offset in range(length)]
    return steps if velocity > 0 else [-step for step in steps]


def sequence_scores(
    rows: Rows,
    ends: Indices | None = None,
    partial: bool = False,
    bounds: SessionBounds = ONE_SESSION,
) -> Values:
    """
    Return how well a sequence of k frames matches each reference, (R,), or those at `ends`, (n,).

    The mean of pair scores along each diagonal (III-G), -inf where it leaves its session, the
    newest pair has no score, or less than half of the pairs have one; `ends` are ascending. If
    `partial`, up to half of the pairs may lie off the session or lack scores, and then count as
    the mean of their row's known ones: a place is found sooner after the start. ValueError if the
    newest frame has no scores; older rows may be shorter. Those of a whole map are float32.
    """
    if rows[0] is None:
        raise ValueError('the newest frame of a sequence must be informative')
    every = np.arange(len(rows[0]))
    ends = every if ends is None else ends
    dtype: Any = np.float32 if len(ends) == len(every) else np.float64
    firsts, stops = bounds.spans(ends)
    total, known = np.zeros(len(ends), dtype), np.zeros(len(ends), dtype)
    scored = partial | (ends - len(rows) + 1 >= firsts)
    for age, row in enumerate(rows):
        if row is None or not len(row):
            continue
        met = ends - age
        pairs = row.take(met, mode='clip')
        there = (met >= firsts) & (met < np.minimum(stops, len(row))) & np.isfinite(pairs)
        total += np.where(there, pairs, mean_score(row) if partial else np.float32(0))
        known += there
        if not age:
            scored &= there
    scored &= 2 * known >= len(rows)
    number = dtype(sum(row is not None for row in rows)) if partial else known
    return np.divide(total, number, out=np.full(len(ends), -np.inf, dtype), where=scored)


def mean_score(row: Row) -> np.float32:
    """Return the mean of what is known of a row, 0 if nothing is."""
    mean = np.mean(row, dtype=np.float64) if len(row) else 0.0
    if not np.isfinite(mean):
        known = row[np.isfinite(row)]
        mean = np.mean(known, dtype=np.float64) if len(known) else 0.0
    return np.float32(mean)
