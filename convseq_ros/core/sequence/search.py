# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which sequences are scored: all of them, as in the paper, or those of a shortlist."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from convseq_ros.config import Config
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence.coarse_scores import CoarseScores
from convseq_ros.core.sequence.coarse_sums import Asked, enough, Sums
from convseq_ros.core.sequence.diagonals import Rows, Values
from convseq_ros.core.sequence.query_buffer import QueryBuffer
from convseq_ros.core.sequence.shortlist import SHORTLIST, Shortlist
from convseq_ros.core.sequence.velocity import ConstantVelocity, VelocitySearch
from convseq_ros.core.types import Descriptor, Indices
import numpy as np

_NONE = np.zeros(0, np.int64)


class Coarse(Protocol):
    """What knows coarse scores of all references: of one map, or of many shards."""

    def reset(self) -> None:
        """Forget the drive."""

    def update(self, descriptor: Descriptor, usable: int) -> Any:
        """Take in a query, each once; return its row, as long as the first references."""

    def peaks(self, rows: Rows, steps: Values) -> Values:
        """Return what `kernels.peaks` does."""

    def sums(self, asked: Sequence[Asked]) -> list[Sums]:
        """Return sums along diagonals, all or those that are asked for."""

    def expect(self, places: Callable[[], Indices]) -> None:
        """Be told what says which places will be read next."""


class Decision(Protocol):
    """What a decision asks for, and what it knows."""

    @property
    def window(self) -> int:
        """Newest frames that must have scores."""

    @property
    def seen_velocity(self) -> float | None:
        """References per frame, if the newest frames alone tell them."""


class ExhaustiveSearch:
    """Scores every reference, as the paper does (III-D)."""

    def __init__(self, velocity: ConstantVelocity) -> None:
        self._velocity = velocity

    def reset(self) -> None:
        self._velocity.reset()

    def update(self, _descriptor: Descriptor, _usable: int) -> Values | None:
        """Take in a frame; return its coarse scores (usable,), if there are any."""
        return None

    def propose(
        self, buffer: QueryBuffer, length: int | None, _of: Decision, usable: int, _rivals: int
    ) -> tuple[Indices, float]:
        """
        Score pairs of the newest frames; return sequence end indices (n,), and the velocity.

        `length` is None if it is not yet known; scores are those that a decision asks for;
        the first `usable` references may be matched; rivals lie more than `rivals` apart.
        """
        ends = np.arange(usable)
        buffer.score(1, ends)
        if length is None:
            return ends, 1.0
        return ends, self._velocity.update(buffer.rows[:length])

    def verify(self, ends: Indices, scores: Values, is_known: bool) -> None:
        """Take note of how sequences have scored, and whether the frame's place is known."""


class ShortlistSearch(ExhaustiveSearch):
    """Scores the `k` sequences that are likely by their coarse scores."""

    def __init__(
        self, velocity: ConstantVelocity, coarse: Coarse, k: int, bounds: SessionBounds
    ) -> None:
        super().__init__(velocity)
        self._coarse, self._shortlist = coarse, Shortlist(k, bounds)
        self._frames = 0  # of the drive

    def reset(self) -> None:
        for stage in (self._velocity, self._coarse, self._shortlist):
            stage.reset()
        self._frames = 0

    def update(self, descriptor: Descriptor, usable: int) -> Values:
        self._frames += 1
        return self._coarse.update(descriptor, usable)

    def verify(self, ends: Indices, scores: Values, is_known: bool) -> None:
        self._shortlist.verify(ends, scores, is_known)

    def propose(
        self, buffer: QueryBuffer, length: int | None, of: Decision, usable: int, rivals: int
    ) -> tuple[Indices, float]:
        if length is None:
            return _NONE, 1.0
        rows, shortlist = [one.coarse for one in buffer.outward[:length]], self._shortlist

        def closer(velocity: float) -> Values:
            wanted = Asked(rows, velocity, enough(SHORTLIST.closer, rivals), _NONE)
            (sums,) = self._coarse.sums([wanted])
            ends = shortlist.top(sums, rivals, SHORTLIST.closer)
            buffer.score(length, ends, velocity)
            return buffer.approximate_scores(length, ends, velocity)

        velocity = self._velocity.update(rows, closer, self._coarse.peaks, of.seen_velocity)
        wanted = shortlist.asked(rows, rivals, velocity)
        scouting, entering = SHORTLIST.scouts, SHORTLIST.entered
        if self._frames <= SHORTLIST.first_frames:
            scouting, entering = SHORTLIST.first_scouts, SHORTLIST.first_entered
        elif length == 1:
            scouting, entering = SHORTLIST.single_scouts, SHORTLIST.first_entered
        newest = Asked(rows[:1], 1.0, enough(scouting, rivals), _NONE)
        sums, alone = self._coarse.sums([wanted, newest])
        ends = shortlist.update(wanted, sums, rivals)
        # What was just entered is likely by the newest frame alone, by pair scores.
        scouts = shortlist.top(alone, rivals, scouting)
        frames = max(length, of.window)
        self._coarse.expect(lambda: np.append(buffer.unscored(frames, ends, velocity), scouts))
        buffer.score(1, scouts)
        scores = buffer.approximate_scores(1, scouts)
        entered = scouts[np.argsort(-scores, kind='stable')[:entering]]
        if length == 1:
            entered = np.append(entered, shortlist.around(entered, usable))
        ends = np.union1d(ends, entered)
        self._coarse.expect(lambda: buffer.unscored(frames, ends, velocity))
        buffer.score_promising(frames, ends, velocity)
        return ends, velocity


def make_search(
    reference_map: ReferenceMap, config: Config, coarse: Coarse | None = None
) -> ExhaustiveSearch:
    """Return the search that a configuration asks for, with what scores a map, if that is told."""
    matching = config.matching
    follows = matching.velocity_search and matching.matching == 'coherent'
    velocity = ConstantVelocity()
    if follows:
        velocity = VelocitySearch(reference_map.bounds, matching.both_directions)
    if matching.search == 'exhaustive':
        return ExhaustiveSearch(velocity)
    above = 0 if config.online.grows else matching.index_above
    coarse, bounds = coarse or CoarseScores(reference_map, above), reference_map.bounds
    return ShortlistSearch(velocity, coarse, matching.shortlist_length, bounds)
