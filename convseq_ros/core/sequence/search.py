# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which sequences are scored: all of them, as in the paper, or those of a shortlist."""

from convseq_ros.config import Config
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.sequence.coarse_scores import CoarseScores
from convseq_ros.core.sequence.diagonals import Indices, Row, Values
from convseq_ros.core.sequence.query_buffer import QueryBuffer
from convseq_ros.core.sequence.shortlist import Shortlist
from convseq_ros.core.sequence.velocity import ConstantVelocity, VelocitySearch
from convseq_ros.core.types import Descriptor
import numpy as np

_CLOSER = 20  # likeliest sequences that are scored for a second velocity; a few ms


class ExhaustiveSearch:
    """Scores every reference, as the paper does."""

    def __init__(self, velocity: ConstantVelocity) -> None:
        self._velocity = velocity

    def reset(self) -> None:
        """Forget the frames so far."""
        self._velocity.reset()

    def update(self, _descriptor: Descriptor, _usable: int) -> Row | None:
        """Take in a frame; return its coarse scores, if there are any."""
        return None

    def propose(
        self, buffer: QueryBuffer, length: int | None, _window: int, usable: int, _rivals: int
    ) -> tuple[Indices, float]:
        """
        Score pairs of the newest frames; return sequence end indices (n,), and the velocity.

        `length` is that of the sequence, None if it is not yet known; the decision asks for scores
        of `window` frames; `usable` references, from the first, may be matched; rivals lie
        further than `rivals` references from each other.
        """
        ends = np.arange(usable)
        buffer.score(1, ends)
        if length is None:
            return ends, 1.0
        return ends, self._velocity.update([one.row for one in buffer.outward[:length]])

    def verify(self, ends: Indices, scores: Values) -> None:
        """Take note of how the sequences scored."""


class ShortlistSearch(ExhaustiveSearch):
    """Scores the sequences that are likely by their coarse scores."""

    def __init__(
        self, velocity: ConstantVelocity, reference_map: ReferenceMap, config: Config
    ) -> None:
        super().__init__(velocity)
        self._coarse = CoarseScores(reference_map)
        self._shortlist = Shortlist(config.matching.shortlist_length)

    def reset(self) -> None:
        """Forget the frames so far."""
        super().reset()
        self._coarse.reset()
        self._shortlist.reset()

    def update(self, descriptor: Descriptor, usable: int) -> Row | None:
        """Take in a frame; return its coarse scores."""
        return self._coarse.update(descriptor, usable)

    def propose(
        self, buffer: QueryBuffer, length: int | None, window: int, _usable: int, rivals: int
    ) -> tuple[Indices, float]:
        """Score pairs of the newest frames; as `ExhaustiveSearch.propose`."""
        if length is None:
            return np.zeros(0, np.int64), 1.0
        coarse = [one.coarse for one in buffer.outward[:length]]

        def closer(velocity: float) -> Values:
            ends = self._shortlist.top(coarse, rivals, velocity, _CLOSER)
            buffer.score(length, ends, velocity)
            return buffer.approximate_scores(length, ends, velocity)

        velocity = self._velocity.update(coarse, closer)
        ends = self._shortlist.update(coarse, rivals, velocity)
        buffer.score_promising(max(length, window), ends, velocity)
        return ends, velocity

    def verify(self, ends: Indices, scores: Values) -> None:
        """Take note of how the sequences scored; the best stay listed."""
        self._shortlist.verify(ends, scores)


def make_search(reference_map: ReferenceMap, config: Config) -> ExhaustiveSearch:
    """Return the search that a configuration asks for."""
    follows = config.matching.velocity_search and config.matching.matching == 'coherent'
    velocity = VelocitySearch() if follows else ConstantVelocity()
    if config.matching.search == 'exhaustive':
        return ExhaustiveSearch(velocity)
    return ShortlistSearch(velocity, reference_map, config)
