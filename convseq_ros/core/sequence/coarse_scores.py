# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Coarse scores: the similarity of a query and all references by their global descriptors.

Both are whitened first: the mean of their session, or drive, is subtracted.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from convseq_ros.core.compiled import array, available, kernel, SIZE
from convseq_ros.core.encoding.first_stage import vector_of
from convseq_ros.core.encoding.regions import unit
from convseq_ros.core.map.place import GrowingArray
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Descriptor, Doubles, Floats, Halves, Indices, Row
import numpy as np

_AT_ONCE = 4096  # rows that are converted to float32 at once, for 4 MB of memory
_PADDED = 16  # the length of vectors is padded to a multiple of this
_GROUP = 64  # size of the groups of scores whose maxima are compared first
_products = kernel('products', array('f2'), SIZE, SIZE, array('f4'), array('f4'))  # kernels.c


def products(rows: Halves, direction: Floats) -> Floats:
    """Return the products (R,), in float32, of rows (R, n) and a direction (n,)."""
    if not available():
        parts = [part @ direction for part in widened(rows)]
        return np.concatenate(parts) if parts else np.zeros(0, np.float32)
    padded = np.zeros(-(-len(direction) // _PADDED) * _PADDED, np.float32)
    padded[: len(direction)] = direction
    result = np.empty(len(rows), np.float32)
    _products(np.ascontiguousarray(rows), *rows.shape, padded, result)
    return result


def widened(rows: Halves) -> Iterator[Floats]:
    """Yield rows in float32, 4096 at a time: all at once would need too much memory."""
    for start in range(0, len(rows), _AT_ONCE):
        yield rows[start : start + _AT_ONCE].astype(np.float32)


@constants
class COARSE:
    """The whitening; tuned by recall on 14 sets, by day and darkened (docs/MATCHING.md)."""

    prior_frames: int = 2  # weight of the map's mean in the drive's mean, in frames
    # Weight of the prior in a session's mean and in all variances, in places or frames.
    prior: int = 20
    least: float = 1e-6  # least variance of a number, and least squared distance from the mean
    power: float = 1 / 8  # of a variance; 1/2 whitens fully, and costs single frames by day
    averaged_anew: float = 1.02  # growth of the map after which its mean is computed again


@dataclass(frozen=True, eq=False, slots=True)
class Usual:
    """Mean and variance of each number of a map's global descriptors, (n,)."""

    mean: Floats
    variance: Floats

    def direction(self, away: Doubles, variance: Doubles) -> Floats:
        """Return the whitened direction (n,) of a query, given its offset from the mean."""
        whitened = unit(away / variance**COARSE.power)
        return np.asarray(whitened / self.variance**COARSE.power, np.float32)


class Centred:
    """References of a map, whitened: relative to the mean of their session."""

    def __init__(self, usual: Usual, references: Halves, starts: Indices) -> None:
        self._weights = usual.variance ** (-2 * COARSE.power)
        self._means = np.tile(usual.mean, (len(starts), 1))
        for mean, session in zip(self._means, np.split(references, starts[1:]), strict=True):
            offsets = sums_of(session)[0] - len(session) * usual.mean.astype(np.float64)
            mean += offsets / (len(session) + COARSE.prior)
        self._map_mean, self._nearness = usual.mean, GrowingArray(np.zeros(0, np.float32))
        self.follow(references, starts)

    def follow(self, references: Halves, starts: Indices) -> None:
        """Take in new references of (R, n); a new session starts with the map's mean."""
        new, first = len(starts) - len(self._means), len(self._nearness)
        self._means = np.append(self._means, np.tile(self._map_mean, (new, 1)), axis=0)
        ends = np.append(starts[1:], len(references))
        for session in np.flatnonzero(ends > first):
            for part in widened(references[max(starts[session], first) : ends[session]]):
                away = (part - self._means[session]).astype(np.float64)
                distances = away**2 @ self._weights
                apart, zeros = distances > COARSE.least, np.zeros(len(part), np.float32)
                self._nearness.extend(np.divide(1, np.sqrt(distances), out=zeros, where=apart))

    def row(self, references: Halves, starts: Indices, direction: Floats) -> Row:
        """Return the cosines (R,) of the first references with a query's direction."""
        row = products(references, direction)
        of_means = (self._means.astype(np.float64) @ direction).astype(np.float32)
        row -= np.repeat(of_means, np.diff(np.minimum(starts, len(row)), append=len(row)))
        row *= self._nearness.view[: len(row)]
        return row


def sums_of(references: Halves) -> Doubles:
    """Return the sums of global descriptors, and of their squares, (2, n)."""
    sums = np.zeros((2, references.shape[1]))
    for part in widened(references):
        squares = np.einsum('ij,ij->j', part, part, dtype=np.float64)
        sums += np.array([part.sum(axis=0, dtype=np.float64), squares])
    return sums


def usual_of(sums: Doubles, count: int) -> Usual:
    """Return mean and variance of `count` global descriptors from `sums_of` them."""
    if not count:
        numbers = sums.shape[1]
        return Usual(np.zeros(numbers, np.float32), np.ones(numbers, np.float32))
    mean, square = sums / count
    variance = np.maximum(square - mean**2, COARSE.least)
    variance = count * variance + COARSE.prior * variance.mean()
    variance = (variance / (count + COARSE.prior)).astype(np.float32)
    return Usual(mean.astype(np.float32), variance)


class DriveMean:
    """The mean and variance of a drive's global descriptors, which whiten its frames."""

    def __init__(self, numbers: int) -> None:
        self._numbers = numbers
        self.reset()

    def reset(self) -> None:
        self._sums, self._frames = np.zeros((2, self._numbers)), 0

    def update(self, descriptor: Descriptor, usual: Usual) -> Floats:
        """Take in a query, each only once; return its whitened direction (n,)."""
        query = vector_of(descriptor).astype(np.float32)
        self._sums += np.array([query, query.astype(np.float64) ** 2])
        self._frames += 1
        total, squares = self._sums
        past = total + COARSE.prior_frames * usual.mean
        away = query - past / (self._frames + COARSE.prior_frames)
        # The variance times the number of frames: the factor does not change a direction.
        variance = squares - total**2 / self._frames + COARSE.prior * usual.variance
        return usual.direction(away, variance)


@constants
class TRACK:
    """The sums along the drive; tuned by recall on drawn and real sets."""

    memory: float = 0.8  # share of a predecessor's sum that is passed on, per keyframe
    reach: int = 3  # largest number of places that a drive passes per keyframe


class Coarse:
    """
    Selects the places that a query is scored with: all of them, as in the paper (III-D).

    Subclasses select the likely places, of a map or of many shards.
    """

    _usable = 0

    def reset(self) -> None: ...

    def update(self, _descriptor: Descriptor, usable: int) -> None:
        """Take in a query, each only once, which may match the first `usable` references."""
        self._usable = usable

    def best(self, _along: int, _newest: int, _passed: Sequence[range] = ()) -> Indices:
        """
        Return the likeliest places, ascending, without those in the ranges `passed`.

        `along` of them are chosen by the sums along the drive, `newest` by the newest query alone.
        """
        return np.arange(self._usable)


class Track:
    """
    Sums of coarse scores along the drive, one for each place.

    The sum of a place is its score plus 80 % of the last sum of the best place just before it. So
    one pass over the row replaces sequence matching at all velocities up to `reach`. In `both`
    directions, the places just after it count as well. Sums stay within a session.
    """

    def __init__(self, both: bool) -> None:
        self._both = both
        self.reset()

    def reset(self) -> None:
        self.sums: Row = np.zeros(0, np.float32)

    def update(self, row: Row, starts: Indices) -> None:
        """Take in the scores of the newest query (R,); sessions begin at `starts`."""
        before, old = self.sums, len(self.sums)
        if not old:
            self.sums = row.copy()
            return
        if len(row) > old:
            before = np.append(before, np.full(len(row) - old, before.min(), np.float32))
        best, bounds = before.copy(), starts[1:]
        for step in range(1, TRACK.reach + 1):
            earlier, later = before[:-step], before[step:]
            if len(bounds):  # nothing is passed on from one session to another
                apart = np.zeros(len(row), np.bool_)
                for back in range(step):
                    apart[bounds[bounds + back < len(row)] + back] = True
                earlier = np.where(apart[step:], -np.inf, earlier)
                later = np.where(apart[step:], -np.inf, later)
            np.maximum(best[step:], earlier, out=best[step:])
            if self._both:
                np.maximum(best[:-step], later, out=best[:-step])
        best *= TRACK.memory
        best += row
        self.sums = best


class CoarseScores(Coarse):
    """
    Scores a query against all references: 1.5 ms and 50 MB at 100,000, in proportion to the map.

    The means of the session and of the drive are subtracted: this removes what night, season or
    surroundings do to every image. Numbers are divided by the fourth root of their standard
    deviation in both, so that those that lamps change most do not dominate.
    """

    def __init__(self, reference_map: ReferenceMap, both: bool = False) -> None:
        self._map, self._track = reference_map, Track(both)
        self.row: Row = np.zeros(0, np.float32)  # cosines with the first references
        self._begin(reference_map.global_descriptors[:0])

    def _begin(self, nothing: Halves) -> None:
        """Start without places; the vectors' length is known from a model's first one."""
        numbers = nothing.shape[1]
        self._sums, self._counted = np.zeros((2, numbers)), 0
        self._usual, self._drive = usual_of(self._sums, 0), DriveMean(numbers)
        self._centred = Centred(self._usual, nothing, np.zeros(1, np.int64))

    def reset(self) -> None:
        self._drive.reset()
        self._track.reset()

    def update(self, descriptor: Descriptor, usable: int | None = None) -> None:
        """Take in a query, each only once; `row` then has its scores, (usable,)."""
        references, starts = self._map.global_descriptors[:usable], self._map.bounds.starts
        if references.shape[1] != self._sums.shape[1]:
            self._begin(references[:0])
        self._follow_map(references, starts)
        direction = self._drive.update(descriptor, self._usual)
        self.row = self._centred.row(references, starts, direction)
        self._track.update(self.row, starts)

    def best(self, along: int, newest: int, passed: Sequence[range] = ()) -> Indices:
        """Return the likeliest places, ascending: see `Coarse.best`."""
        return np.union1d(top(self._track.sums, along, passed), top(self.row, newest, passed))

    def _follow_map(self, references: Halves, starts: Indices) -> None:
        if len(references) > COARSE.averaged_anew * self._counted:
            self._sums += sums_of(references[self._counted :])
            self._counted = len(references)
            self._usual = usual_of(self._sums, self._counted)
            self._centred = Centred(self._usual, references, starts)
        self._centred.follow(references, starts)


def top(scores: Row, count: int, passed: Sequence[range] = ()) -> Indices:
    """Return the indices of the `count` best scores, best first, none in the ranges `passed`."""
    if passed:
        scores = scores.copy()
        for indices in passed:
            scores[max(0, indices.start) : max(0, indices.stop)] = -np.inf
    if not count:
        return np.zeros(0, np.int64)
    groups = len(scores) // _GROUP
    if groups > count:
        # `count` groups have a maximum of at least this threshold, so no best score is below it.
        best = scores[: groups * _GROUP].reshape(_GROUP, groups).max(axis=0)
        likely = np.flatnonzero(scores >= np.partition(best, groups - count)[groups - count])
    else:
        likely = np.arange(len(scores))
    best_first = likely[np.argsort(-scores[likely], kind='stable')][:count]
    return best_first[np.isfinite(scores[best_first])]
