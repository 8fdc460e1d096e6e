# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coarse scores of a query and all places of a fleet; what `CoarseScores` is to one map."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from convseq_ros.core.sequence.centred import Usual
from convseq_ros.core.sequence.coarse_scores import DriveMean
from convseq_ros.core.similarity.kernels.numpy_halves import Floats
from convseq_ros.core.types import Descriptor, Indices
from convseq_ros.fleet.shard import Answer, KEPT, Question
import numpy as np


class FleetScores:
    """Asks all shards, by the direction of the newest frame; of a camera, by its number."""

    def __init__(
        self, ask: Callable[[Question], Answer], usual: Usual, both: bool, camera: int
    ) -> None:
        self._ask, self._usual, self._both, self._camera = ask, usual, both, camera
        self._mean, self._drive, self._frame = DriveMean(len(usual.mean)), 0, 0
        self._directions = deque[Floats](maxlen=KEPT)

    def reset(self) -> None:
        """Forget the drive."""
        self._mean.reset()
        self._directions.clear()
        self._drive, self._frame = self._drive + 1, 0

    def update(self, descriptor: Descriptor, _usable: int) -> None:
        """Take in a query, each once; it may show every place, as fleets do not grow."""
        self._directions.append(self._mean.update(descriptor, self._usual))
        self._frame += 1

    def best(self, along: int, newest: int, passed: Sequence[range] = ()) -> Indices:
        """Return what `Coarse` says; who lacks frames of the drive is told them."""
        drive, last = (self._camera, self._drive, self._frame), [self._directions[-1]]
        asked = Question(self._usual, self._both, *drive, last, along, newest, passed)
        answer = self._ask(asked)
        if answer.lacks:
            answer = self._ask(replace(asked, directions=[*self._directions]))
        return np.union1d(answer.along.places, answer.newest.places)
