# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shortlist: which diagonals are worth scoring, by the top k of their coarse scores."""

from dataclasses import dataclass

from convseq_ros.core.sequence.diagonals import (
    diagonal,
    Indices,
    Row,
    Rows,
    sequence_scores,
    Values,
)
import numpy as np


@dataclass(frozen=True, slots=True)
class ShortlistConstants:
    """Of the choice; by recall of the right place on halves of real maps (docs/MATCHING.md)."""

    elsewhere: int = 4  # one of so many lies no nearer to another than the rivals' distance
    hysteresis: float = 0.5  # standard deviations by which a listed one is preferred
    admission: int = 6  # one of so many may be new; a new one costs a whole sequence of pairs
    verified: int = 5  # one of so many, the best by pair scores, stays whatever its coarse score
    group: int = 64  # scores of which only the best is looked at first


SHORTLIST = ShortlistConstants()


class Shortlist:
    """
    Lists the sequence end indices whose coarse sequence scores are best.

    Of so many, a quarter lie no nearer to each other than the rivals' distance, so that rivals are
    among them.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self.reset()

    def reset(self) -> None:
        """Forget what was listed."""
        self._newest: Row | None = None
        self._listed = self._verified = np.zeros(0, np.int64)

    def update(self, rows: Rows, rival_distance: int, velocity: float = 1.0) -> Indices:
        """
        Return the ends, ascending, of the diagonals that are listed now, by rows of coarse scores.

        Those that were listed before are preferred by half a standard deviation, and no more than
        a sixth are new.
        """
        scores = sequence_scores(rows, velocity, dtype=np.float32, partial=True)
        before = self._continued(self._listed, rows, velocity, len(scores))
        verified = self._continued(self._verified, rows, velocity, len(scores))
        self._verified = np.zeros(0, np.int64)
        finite = np.isfinite(scores)
        if len(before) and finite.any():
            scores[before] += SHORTLIST.hysteresis * scores[finite].std()
            scores[verified] += np.ptp(scores[finite])
        listed = _best(scores, self._length, rival_distance)
        if len(before):
            new = [index for index in listed if index not in before]
            late = set(new[self._length // SHORTLIST.admission :])
            listed = [index for index in listed if index not in late]
        self._newest, self._listed = rows[0], np.array(sorted(listed), np.int64)
        return self._listed

    def top(self, rows: Rows, rival_distance: int, velocity: float, length: int) -> Indices:
        """Return the best so many sequence end indices, ascending, whatever was listed before."""
        scores = sequence_scores(rows, velocity, dtype=np.float32, partial=True)
        return np.array(sorted(_best(scores, length, rival_distance)), np.int64)

    def verify(self, ends: Indices, scores: Values) -> None:
        """Take note of how listed sequences have scored, pair by pair; a fifth stays listed."""
        best = np.argsort(-scores, kind='stable')[: self._length // SHORTLIST.verified]
        self._verified = ends[best]

    def _continued(self, ends: Indices, rows: Rows, velocity: float, count: int) -> Indices:
        """Return where diagonals that were listed for an earlier frame end now."""
        for step, row in zip(diagonal(len(rows), velocity), rows, strict=True):
            if row is not None and row is self._newest:
                return ends[ends < count - step] + step
        return np.zeros(0, np.int64)


def _best(scores: Values, length: int, rival_distance: int) -> list[int]:
    """Return the best, and for the last quarter the best elsewhere; uses scores up."""
    most = length - length // SHORTLIST.elsewhere
    best = _top(scores, most)
    best = best[np.argsort(-scores[best], kind='stable')][:most]
    listed = best[np.isfinite(scores[best])].tolist()

    def pass_over(index: int) -> None:
        scores[max(0, index - rival_distance) : index + rival_distance + 1] = -np.inf

    for index in listed:
        pass_over(index)
    for _ in range(length // SHORTLIST.elsewhere):
        index = int(scores.argmax())
        if not np.isfinite(scores[index]):
            break
        listed.append(index)
        pass_over(index)
    return listed


def _top(scores: Values, most: int) -> Indices:
    """Return where the best so many scores are, ascending, and some others."""
    groups = len(scores) // SHORTLIST.group
    if groups <= most:
        return np.arange(len(scores))
    # So many groups have a score that is no worse than this one.
    best = scores[: groups * SHORTLIST.group].reshape(SHORTLIST.group, groups).max(axis=0)
    bound = np.partition(best, groups - most)[groups - most]
    return np.flatnonzero(scores >= bound)
