# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which sequences are scored: all of them, as in the paper, or those of a shortlist."""

from convseq_ros.config import Config
from convseq_ros.core.constants import constants
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence.coarse_scores import CoarseScores
from convseq_ros.core.sequence.diagonals import (
    diagonal,
    ONE_SESSION,
    Rows,
    sequence_scores,
    Values,
)
from convseq_ros.core.sequence.query_buffer import QueryBuffer
from convseq_ros.core.sequence.velocity import ConstantVelocity, VelocitySearch
from convseq_ros.core.types import Descriptor, Indices
import numpy as np

_NONE = np.zeros(0, np.int64)


@constants
class SHORTLIST:
    """Of the choice; by recall of the right place on halves of real maps (docs/MATCHING.md)."""

    elsewhere: int = 4  # one of so many lies no nearer to another than the rivals' distance
    hysteresis: float = 0.5  # standard deviations by which a listed one is preferred
    admission: int = 6  # one of so many may be new; a new one costs a whole sequence of pairs
    verified: int = 5  # one of so many, the best by pair scores, stays whatever its coarse score
    group: int = 64  # scores of which only the best is looked at first
    scouts: int = 12  # places that are likely by the newest frame alone, which get one pair each
    entered: int = 2  # best of these that are listed: a map may just have been entered there
    closer: int = 20  # likeliest sequences that are scored for a second velocity; a few ms


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
        self, buffer: QueryBuffer, length: int | None, _window: int, usable: int, _rivals: int
    ) -> tuple[Indices, float]:
        """
        Score pairs of the newest frames; return sequence end indices (n,), and the velocity.

        `length` is None if it is not yet known; the decision asks for scores of `window` frames;
        the first `usable` references may be matched; rivals lie more than `rivals` apart.
        """
        ends = np.arange(usable)
        buffer.score(1, ends)
        if length is None:
            return ends, 1.0
        return ends, self._velocity.update(buffer.rows[:length])

    def verify(self, ends: Indices, scores: Values) -> None: ...


class ShortlistSearch(ExhaustiveSearch):
    """Scores the `k` sequences that are likely by their coarse scores."""

    def __init__(self, velocity: ConstantVelocity, reference_map: ReferenceMap, k: int) -> None:
        super().__init__(velocity)
        self._coarse = CoarseScores(reference_map)
        self._shortlist = Shortlist(k, reference_map.bounds)

    def reset(self) -> None:
        for stage in (self._velocity, self._coarse, self._shortlist):
            stage.reset()

    def update(self, descriptor: Descriptor, usable: int) -> Values:
        return self._coarse.update(descriptor, usable)

    def verify(self, ends: Indices, scores: Values) -> None:
        self._shortlist.verify(ends, scores)

    def propose(
        self, buffer: QueryBuffer, length: int | None, window: int, _usable: int, rivals: int
    ) -> tuple[Indices, float]:
        if length is None:
            return _NONE, 1.0
        coarse = [one.coarse for one in buffer.outward[:length]]

        def closer(velocity: float) -> Values:
            ends = self._shortlist.top(coarse, rivals, velocity, SHORTLIST.closer)
            buffer.score(length, ends, velocity)
            return buffer.approximate_scores(length, ends, velocity)

        velocity = self._velocity.update(coarse, closer)
        ends = self._shortlist.update(coarse, rivals, velocity)
        ends = np.union1d(ends, self._scouted(buffer, rivals))
        buffer.score_promising(max(length, window), ends, velocity)
        return ends, velocity

    def _scouted(self, buffer: QueryBuffer, rivals: int) -> Indices:
        """Return where the newest frame alone is likely, by pair scores: what was just entered."""
        if (coarse := buffer.newest.coarse) is None:
            return _NONE
        scouts = self._shortlist.top([coarse], rivals, 1.0, SHORTLIST.scouts)
        buffer.score(1, scouts)
        scores = buffer.approximate_scores(1, scouts)
        return scouts[np.argsort(-scores, kind='stable')[: SHORTLIST.entered]]


class Shortlist:
    """Lists the sequence end indices of best coarse scores; a quarter of them are rivals."""

    def __init__(self, length: int, bounds: SessionBounds = ONE_SESSION) -> None:
        self._length, self._bounds = length, bounds
        self.reset()

    def reset(self) -> None:
        self._newest: Values | None = None
        self._listed = self._verified = _NONE

    def update(self, rows: Rows, rival_distance: int, velocity: float = 1.0) -> Indices:
        """Return the ends, ascending, of diagonals by coarse scores; a sixth at most are new."""
        scores = sequence_scores(rows, velocity, partial=True, bounds=self._bounds)
        old, before, verified = (self._listed, self._verified), _NONE, _NONE
        for step, row in zip(diagonal(len(rows), velocity), rows, strict=True):
            if row is not None and row is self._newest:
                # Where diagonals that were listed for this frame end now.
                before, verified = (self._later(ends, step, len(scores)) for ends in old)
                break
        self._verified = _NONE
        finite = np.isfinite(scores)
        if len(before) and finite.any():
            scores[before] += SHORTLIST.hysteresis * scores[finite].std()
            scores[verified] += np.ptp(scores[finite])
        listed = self._best(scores, self._length, rival_distance)
        if len(before):
            new = [index for index in listed if index not in before]
            listed = list(set(listed).difference(new[self._length // SHORTLIST.admission :]))
        self._newest, self._listed = rows[0], np.array(sorted(listed), np.int64)
        return self._listed

    def top(self, rows: Rows, rival_distance: int, velocity: float, length: int) -> Indices:
        """Return the best so many sequence end indices, ascending, whatever was listed before."""
        scores = sequence_scores(rows, velocity, partial=True, bounds=self._bounds)
        return np.array(sorted(self._best(scores, length, rival_distance)), np.int64)

    def verify(self, ends: Indices, scores: Values) -> None:
        """Take note of how listed sequences have scored, pair by pair; a fifth stays listed."""
        best = np.argsort(-scores, kind='stable')[: self._length // SHORTLIST.verified]
        self._verified = ends[best]

    def _later(self, ends: Indices, step: int, usable: int) -> Indices:
        """Return places so many further on in their sessions, of those that have such a one."""
        later = ends + step
        there = self._bounds.firsts(later) == self._bounds.firsts(ends)
        return later[there & (later < usable)]

    def _best(self, scores: Values, length: int, rival_distance: int) -> list[int]:
        """Return the best, and for the last quarter the best elsewhere; uses scores up."""
        elsewhere = length // SHORTLIST.elsewhere
        best = _top(scores, length - elsewhere)
        best = best[np.argsort(-scores[best], kind='stable')][: length - elsewhere]
        listed = best[np.isfinite(scores[best])].tolist()
        passed = list(listed)
        for _ in range(elsewhere):
            for index in passed:
                near = self._bounds.around(index, rival_distance)
                scores[near.start : near.stop] = -np.inf
            passed = [int(scores.argmax())]
            if not np.isfinite(scores[passed[0]]):
                break
            listed += passed
        return listed


def make_search(reference_map: ReferenceMap, config: Config) -> ExhaustiveSearch:
    """Return the search that a configuration asks for."""
    matching = config.matching
    follows = matching.velocity_search and matching.matching == 'coherent'
    velocity = VelocitySearch(reference_map.bounds) if follows else ConstantVelocity()
    if matching.search == 'exhaustive':
        return ExhaustiveSearch(velocity)
    return ShortlistSearch(velocity, reference_map, matching.shortlist_length)


def _top(scores: Values, most: int) -> Indices:
    """Return where the best so many scores are, ascending, and some others."""
    groups = len(scores) // SHORTLIST.group
    if groups <= most:
        return np.arange(len(scores))
    # So many groups have a score that is no worse than this one.
    best = scores[: groups * SHORTLIST.group].reshape(SHORTLIST.group, groups).max(axis=0)
    bound = np.partition(best, groups - most)[groups - most]
    return np.flatnonzero(scores >= bound)
