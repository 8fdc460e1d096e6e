# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rolling buffer of query frames, and their pair scores as far as they are known."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from convseq_ros.core.matcher import Matcher
from convseq_ros.core.sequence.diagonals import diagonal, Row, sequence_scores
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

_SETTLED_ENDS = 8
# Ten times the largest error that was seen, of single pairs; sequences average theirs away.
_WITHIN = 0.02

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Seen:
    """
    A frame of the buffer.

    Parameters
    ----------
    descriptor : Descriptor
        What it shows.
    query : object
        What is compared of it; None if it shows nothing.
    row : ndarray of float32, shape (R,), or None
        Pair scores with the references that may be matched, NaN where there is none.
    first_sight : ndarray of float32, shape (R,), or None
        How alike they are at first sight.

    """

    descriptor: Descriptor
    query: Any = None
    row: Row | None = None
    first_sight: Row | None = None
    settled: set[int] = field(default_factory=set)


class QueryBuffer:
    """
    Keeps the last frames, and scores each pair of frame and reference once.

    Parameters
    ----------
    matcher : Matcher
        What scores pairs.
    partial : bool
        Whether sequences may leave the map, as `sequence_scores` says.

    Attributes
    ----------
    frame : int
        The number of the newest frame; it goes on when the buffer is emptied.
    pairs_scored : int
        Pairs that were scored since that frame came.

    """

    def __init__(self, matcher: Matcher, partial: bool) -> None:
        self.frame = 0
        self.pairs_scored = 0
        self._matcher = matcher
        self._partial = partial
        self._frames: deque[Seen] = deque()

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def newest(self) -> Seen:
        """The frame that came last."""
        return self._frames[-1]

    @property
    def outward(self) -> list[Seen]:
        """All frames, newest first."""
        return list(reversed(self._frames))

    def clear(self, missed: int = 0) -> None:
        """Forget all frames, and count some that were missed."""
        self._frames.clear()
        self.frame += missed

    def append(self, seen: Seen, most: int) -> None:
        """Add the newest frame and keep no more than so many."""
        self._frames.append(seen)
        self.frame += 1
        self.pairs_scored = 0
        while len(self._frames) > most:
            self._frames.popleft()

    def score(self, count: int, ends: Indices, slope: float = 1.0) -> None:
        """
        Score what is missing on some diagonals.

        Parameters
        ----------
        count : int
            How many frames back from the newest.
        ends : ndarray of int64, shape (n,)
            The references at which the diagonals end.
        slope : float
            References that pass while one frame does.

        """
        lacking = [
            (row, one.query, met[np.isnan(row[met])])
            for one, row, met in _diagonals(self.outward[:count], ends, slope)
        ]
        found = self._matcher.scores_of([(query, missing) for _, query, missing in lacking])
        for (row, _, missing), scores in zip(lacking, found, strict=True):
            row[missing] = scores
            self.pairs_scored += len(missing)

    def score_promising(self, count: int, ends: Indices, slope: float = 1.0) -> None:
        """
        Score the newest half of some diagonals and, of the better half of them, the rest.

        All of all where sequences may not leave the map, and so lack no scores.
        """
        newest = -(-count // 2) if self._partial else count
        self.score(newest, ends, slope)
        rough = self.rough_scores(min(newest, len(self)), ends, slope)
        better = np.argsort(-rough, kind='stable')[: -(-len(ends) // 2)]
        self.score(count, ends[np.sort(better)], slope)

    def rough_scores(
        self, length: int, ends: Indices, slope: float = 1.0
    ) -> npt.NDArray[np.float64]:
        """
        Return how well the newest frames match some diagonals that were scored.

        Parameters
        ----------
        length, ends, slope : int, ndarray of int64, shape (n,), float
            As for `score`.

        Returns
        -------
        ndarray of float64, shape (n,)
            As the function `sequence_scores` gives them.

        """
        rows = [one.row for one in self.outward[:length]]
        return sequence_scores(rows, slope=slope, ends=ends, partial=self._partial)

    def sequence_scores(
        self, length: int, ends: Indices, slope: float = 1.0
    ) -> npt.NDArray[np.float64]:
        """
        Return `rough_scores`, but exact for whatever may be the best.

        Where the kernel approximates, these are those within 0.02 of the best, and 8 at most.
        """
        scores = self.rough_scores(length, ends, slope)
        if self._matcher.exact:
            return scores
        best = np.argsort(-scores, kind='stable')[:_SETTLED_ENDS]
        best = best[scores[best] >= scores.max(initial=-np.inf) - _WITHIN]
        for one, row, met in _diagonals(self.outward[:length], ends[best], slope):
            rough = np.array([index for index in met if index not in one.settled], np.int64)
            row[rough] = self._matcher.exact_scores(one.query, rough)
            one.settled.update(rough.tolist())
        return self.rough_scores(length, ends, slope)


def _diagonals(
    window: Sequence[Seen], ends: Indices, slope: float
) -> Iterator[tuple[Seen, Row, Indices]]:
    """Yield each frame that shows something, its row, and the references that it meets."""
    for step, one in zip(diagonal(len(window), slope), window, strict=True):
        if one.row is not None:
            met = ends - step
            yield one, one.row, met[(met >= 0) & (met < len(one.row))]
