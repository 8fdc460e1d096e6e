# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which references are worth scoring: a shortlist by pooled descriptors along diagonals."""

from collections.abc import Iterator, Sequence

from convseq_ros.core.encoding.global_descriptor import pooled
from convseq_ros.core.encoding.unit import unit
from convseq_ros.core.map.growing_array import GrowingArray
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.sequence.diagonals import diagonal, Row, sequence_scores
from convseq_ros.core.similarity.kernels.instructions import float_tile
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

_PRIOR_FRAMES = 2
_PRIOR_OF_SPREAD = 20
_LEAST_VARIANCE = 1e-6
# Of a variance; a half would take off all of the spread, and cost single frames by day.
_POWER = 1 / 8
_ELSEWHERE = 4
_AVERAGED_ANEW = 1.02
_LEAST_DISTANCE = 1e-6
_LOYALTY = 0.5
_NEWCOMERS = 6
_PROVEN = 5
_WIDENED_AT_ONCE = 4096
_GROUP = 64


class Shortlist:
    """
    Finds the references where a sequence may end, at the cost of one product a reference.

    The map's mean is taken from its references, and the mean of the query's own past from the
    query, so that what night or season does to every image counts for nothing. And each of the
    numbers is divided by the fourth root of what it varies by, in the map and on the drive: in the
    dark, those that lamps change most would speak for all. The map may grow; its mean and its
    spread are taken anew whenever it has grown by a fiftieth.

    Parameters
    ----------
    reference_map : ReferenceMap
        The references.
    length : int
        How many ends are listed.
    rival_distance : int
        A quarter of them lie no nearer to each other than this, so that rivals are among them.

    Notes
    -----
    A row takes time and memory in proportion to the map: about 1.5 ms and 50 MB at 100,000
    references. Above about a million, an index over `ReferenceMap.pooled` should answer instead,
    in rows that are NaN but for the references that it names; only this class would change.

    """

    def __init__(self, reference_map: ReferenceMap, length: int, rival_distance: int) -> None:
        self._map = reference_map
        self._length = length
        self._rival_distance = rival_distance
        numbers = reference_map.pooled.shape[1]
        self._total, self._squares = np.zeros(numbers), np.zeros(numbers)
        self._counted = self._averaged = 0
        self._mean, self._variance = np.zeros(numbers, np.float32), np.ones(numbers, np.float32)
        self._nearness = GrowingArray(np.zeros(0, np.float32))
        self._own_total, self._own_squares = np.zeros(numbers), np.zeros(numbers)
        self._frames = 0
        self._newest: Row | None = None
        self._listed = self._proven = np.zeros(0, np.int64)
        # Compiles it, so that the first frame is not late.
        products(reference_map.pooled[:0], self._mean)

    def row(self, descriptor: Descriptor, usable: int | None = None) -> Row:
        """
        Return how alike a query and the references are at first sight.

        Parameters
        ----------
        descriptor : Descriptor
            Of the query; each frame comes once.
        usable : int, optional
            How many references, from the first, may be matched; all by default.

        Returns
        -------
        ndarray of float32, shape (usable,)
            Cosines, in [-1, 1].

        """
        references = self._map.pooled[:usable]
        self._take_in(references)
        query = pooled(descriptor.cells).astype(np.float32)
        self._own_total += query
        self._own_squares += query.astype(np.float64) ** 2
        self._frames += 1
        past = self._own_total + _PRIOR_FRAMES * self._mean
        away = query - past / (self._frames + _PRIOR_FRAMES)
        # Of the drive, so many times; how often makes no difference to a direction.
        variance = self._own_squares - self._own_total**2 / self._frames
        variance += _PRIOR_OF_SPREAD * self._variance
        own = unit(away / variance**_POWER)
        direction = (own / self._variance**_POWER).astype(np.float32)
        row = products(references, direction)
        row -= self._mean @ direction
        row *= self._nearness.view[: len(references)]
        return row

    def ends(
        self, rows: Sequence[Row | None], slope: float = 1.0, length: int = 0
    ) -> npt.NDArray[np.int64]:
        """
        Return the references, ascending, where the diagonals of the best sequences end.

        Of the usual number, those that were listed before are preferred by half a standard
        deviation, and no more than a sixth are new: a new one costs a whole sequence of pairs.

        Parameters
        ----------
        rows : sequence of k ndarrays of float32, shape (R,), or None
            From `row`, newest first.
        slope : float
            References that pass while one frame does.
        length : int
            How many are listed; 0 for the usual number.

        """
        scores = sequence_scores(rows, slope=slope, dtype=np.float32, partial=True)
        if length:
            return np.array(sorted(self._best(scores, length)), np.int64)
        before = self._continued(self._listed, rows, slope, len(scores))
        proven = self._continued(self._proven, rows, slope, len(scores))
        self._proven = np.zeros(0, np.int64)
        finite = np.isfinite(scores)
        if len(before) and finite.any():
            scores[before] += _LOYALTY * scores[finite].std()
            scores[proven] += np.ptp(scores[finite])
        listed = self._best(scores, self._length)
        if len(before):
            newcomers = [index for index in listed if index not in before]
            late = set(newcomers[self._length // _NEWCOMERS :])
            listed = [index for index in listed if index not in late]
        self._newest, self._listed = rows[0], np.array(sorted(listed), np.int64)
        return self._listed

    def prove(self, ends: npt.NDArray[np.int64], scores: npt.NDArray[np.floating]) -> None:
        """Take note of how sequences that were listed have scored; a fifth stays listed."""
        best = np.argsort(-scores, kind='stable')[: self._length // _PROVEN]
        self._proven = ends[best]

    def _continued(
        self, ends: npt.NDArray[np.int64], rows: Sequence[Row | None], slope: float, count: int
    ) -> npt.NDArray[np.int64]:
        """Return where diagonals that were listed for an earlier frame end now."""
        for step, row in zip(diagonal(len(rows), slope), rows, strict=True):
            if row is not None and row is self._newest:
                return ends[ends < count - step] + step
        return np.zeros(0, np.int64)

    def _best(self, scores: npt.NDArray[np.float32], length: int) -> list[int]:
        """Return the best, and for the last quarter the best elsewhere; uses scores up."""
        most = length - length // _ELSEWHERE
        best = _among_the_best(scores, most)
        best = best[np.argsort(-scores[best], kind='stable')][:most]
        listed = best[np.isfinite(scores[best])].tolist()
        for index in listed:
            self._pass_over(scores, index)
        for _ in range(length // _ELSEWHERE):
            index = int(scores.argmax())
            if not np.isfinite(scores[index]):
                break
            listed.append(index)
            self._pass_over(scores, index)
        return listed

    def _pass_over(self, scores: npt.NDArray[np.floating], index: int) -> None:
        near = max(0, index - self._rival_distance)
        scores[near : index + self._rival_distance + 1] = -np.inf

    def _take_in(self, references: npt.NDArray[np.float16]) -> None:
        """Learn the mean, and how far each reference is from it; `_nearness` is the inverse."""
        count = len(references)
        if count > _AVERAGED_ANEW * self._averaged:
            for some in _widened(references[self._counted :]):
                self._total += some.sum(axis=0, dtype=np.float64)
                self._squares += np.einsum('ij,ij->j', some, some, dtype=np.float64)
            self._counted = self._averaged = count
            mean = self._total / count
            variance = np.maximum(self._squares / count - mean**2, _LEAST_VARIANCE)
            variance = count * variance + _PRIOR_OF_SPREAD * variance.mean()
            self._mean = mean.astype(np.float32)
            self._variance = (variance / (count + _PRIOR_OF_SPREAD)).astype(np.float32)
            self._nearness = GrowingArray(self._inverse_distances(references))
        known = len(self._nearness)
        for inverse in self._inverse_distances(references[known:]):
            self._nearness.append(inverse)

    def _inverse_distances(self, references: npt.NDArray[np.float16]) -> npt.NDArray[np.float32]:
        inverse = np.zeros(len(references), np.float32)
        weights = self._variance ** (-2 * _POWER)
        start = 0
        for some in _widened(references):
            distances = (some - self._mean) ** 2 @ weights
            apart = distances > _LEAST_DISTANCE
            here = inverse[start : start + len(some)]
            np.divide(1, np.sqrt(distances), out=here, where=apart)
            start += len(some)
        return inverse


def _among_the_best(scores: npt.NDArray[np.floating], most: int) -> npt.NDArray[np.int64]:
    """Return where the best so many scores are, ascending, and some others."""
    groups = len(scores) // _GROUP
    if groups <= most:
        return np.arange(len(scores))
    # So many groups have a score that is no worse than this one.
    best = scores[: groups * _GROUP].reshape(_GROUP, groups).max(axis=0)
    bound = np.partition(best, groups - most)[groups - most]
    return np.flatnonzero(scores >= bound)


def products(
    rows: npt.NDArray[np.float16], direction: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Return the products, in float32, of rows (R, n) and a direction (n,), shape (R,)."""
    tile = float_tile()
    if tile and len(direction) >= tile.lanes:
        from convseq_ros.core.similarity.kernels import halves

        return halves.products(rows, direction)
    found = [some @ direction for some in _widened(rows)]
    return np.concatenate(found) if found else np.zeros(0, np.float32)


def _widened(rows: npt.NDArray[np.float16]) -> Iterator[npt.NDArray[np.float32]]:
    """Yield rows in float32, some at a time, as all of them would take as much memory again."""
    for start in range(0, len(rows), _WIDENED_AT_ONCE):
        yield rows[start : start + _WIDENED_AT_ONCE].astype(np.float32)
