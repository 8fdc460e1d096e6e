# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coarse scores of a fleet: what `CoarseScores` is to one map."""

from collections.abc import Callable, Sequence
from typing import Any
from uuid import uuid4

from convseq_ros.core.sequence.centred import Usual
from convseq_ros.core.sequence.coarse_scores import DriveMean
from convseq_ros.core.sequence.coarse_sums import Asked, Sums
from convseq_ros.core.sequence.diagonals import Values
from convseq_ros.core.types import Descriptor, Indices
from convseq_ros.fleet.shard import Answer, Direction, Question
import numpy as np

_KEPT_MEANS = 128  # of rows; a sequence has 100 at most

Rows = Sequence[Any]  # of directions, newest first; None for an uninformative frame


class FleetScores:
    """Asks all shards; a row is its direction, and is sent whole with every question."""

    def __init__(
        self,
        ask: Callable[[Question], Answer],
        read: Callable[[Sequence[int]], Any],
        usual: Usual,
        usual_key: str,
        count: int,
        index_above: int = 0,
    ) -> None:
        self._ask, self._read, self._usual, self._count = ask, read, usual, count
        self._drive, self._key = DriveMean(len(usual.mean)), str(uuid4())
        self._index_above = index_above
        self._usual_key = usual_key  # of all cameras that ask a fleet
        self._frames, self._means = 0, dict[str, np.float32]()

    def reset(self) -> None:
        """Forget the drive."""
        self._drive.reset()
        self._means.clear()

    def update(self, descriptor: Descriptor, _usable: int | None = None) -> Direction:
        """Take in a query, each once; return what stands for its scores with all references."""
        self._frames += 1
        numbers = self._drive.update(descriptor, self._usual)
        return Direction(f'{self._key}/{self._frames}', numbers, self._count)

    def peaks(self, rows: Rows, steps: Values) -> Values:
        """Return what `kernels.peaks` does of all shards."""
        answer = self._asked(rows, steps)
        highest, total, count = (
            np.zeros((3, len(steps))) if answer.peaks is None else answer.peaks.T
        )
        return np.column_stack((highest, total / np.maximum(count, 1), count))

    def sums(self, asked: Sequence[Asked]) -> list[Sums]:
        """Return the sums along diagonals that are asked for."""
        for one in asked:
            for row in one.rows:
                if row is not None and row.key not in self._means:
                    self._asked([row], None)
        return [*self._ask(self._question(asked=asked, means=dict(self._means))).sums]

    def expect(self, places: Callable[[], Indices]) -> None:
        """Have places read in one go that are asked for in several."""
        self._read(places().tolist())

    def _asked(self, rows: Rows, steps: Values | None) -> Answer:
        """Ask for peaks, and get the mean of the newest row with it."""
        answer = self._ask(self._question(rows=rows, steps=steps))
        for key, (total, count) in answer.totals.items():
            self._means[key] = np.float32(total / count if count else 0.0)
        self._means = dict([*self._means.items()][-_KEPT_MEANS:])
        return answer

    def _question(self, **what: Any) -> Question:
        return Question(self._usual_key, self._usual, index_above=self._index_above, **what)
