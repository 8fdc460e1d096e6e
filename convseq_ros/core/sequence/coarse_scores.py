# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Coarse scores: how alike a query and all references are by their global descriptors.

References are compared as they are seen from what their own session usually shows.
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

_AT_ONCE = 4096  # rows in float32, for 4 MB of memory
_PADDED = 16  # numbers; rows are multiplied so many at a time
_GROUP = 64  # scores of which only the best is looked at first
_products = kernel('products', array('f2'), SIZE, SIZE, array('f4'), array('f4'))  # kernels.c


def products(rows: Halves, direction: Floats) -> Floats:
    """Return the products, in float32, of rows (R, n) and a direction (n,), shape (R,)."""
    if not available():
        every = [some @ direction for some in widened(rows)]
        return np.concatenate(every) if every else np.zeros(0, np.float32)
    padded = np.zeros(-(-len(direction) // _PADDED) * _PADDED, np.float32)
    padded[: len(direction)] = direction
    found = np.empty(len(rows), np.float32)
    _products(np.ascontiguousarray(rows), *rows.shape, padded, found)
    return found


def widened(rows: Halves) -> Iterator[Floats]:
    """Yield rows in float32, some at a time, as all of them would take as much memory again."""
    for start in range(0, len(rows), _AT_ONCE):
        yield rows[start : start + _AT_ONCE].astype(np.float32)


@constants
class COARSE:
    """Of the whitening; chosen by recall on 14 sets, by day and darkened (docs/MATCHING.md)."""

    prior_frames: int = 2  # that the map's mean counts for in the drive's
    # Places or frames that count beforehand: in a session's mean, and in all variances.
    prior: int = 20
    least: float = 1e-6  # variance of a number, and squared distance from the mean
    power: float = 1 / 8  # of a variance; 1/2 takes off all spread, and costs single frames by day
    averaged_anew: float = 1.02  # growth of the map after which its mean is taken anew


@dataclass(frozen=True, eq=False, slots=True)
class Usual:
    """What global descriptors of a map usually are: mean and variance of each number, (n,)."""

    mean: Floats
    variance: Floats

    def direction(self, away: Doubles, variance: Doubles) -> Floats:
        """Return in which direction (n,) references lie that are like a query."""
        own = unit(away / variance**COARSE.power)
        return np.asarray(own / self.variance**COARSE.power, np.float32)


class Centred:
    """References of one map, each seen from what its own session usually shows."""

    def __init__(self, usual: Usual, references: Halves, starts: Indices) -> None:
        self._weights = usual.variance ** (-2 * COARSE.power)
        self._means = np.tile(usual.mean, (len(starts), 1))
        for own, session in zip(self._means, np.split(references, starts[1:]), strict=True):
            more = sums_of(session)[0] - len(session) * usual.mean.astype(np.float64)
            own += more / (len(session) + COARSE.prior)
        self._map_mean, self._nearness = usual.mean, GrowingArray(np.zeros(0, np.float32))
        self.follow(references, starts)

    def follow(self, references: Halves, starts: Indices) -> None:
        """Take in what is new of references (R, n); a new session is usual as the map is."""
        new, first = len(starts) - len(self._means), len(self._nearness)
        self._means = np.append(self._means, np.tile(self._map_mean, (new, 1)), axis=0)
        ends = np.append(starts[1:], len(references))
        for session in np.flatnonzero(ends > first):
            for some in widened(references[max(starts[session], first) : ends[session]]):
                away = (some - self._means[session]).astype(np.float64)
                distances = away**2 @ self._weights
                apart, here = distances > COARSE.least, np.zeros(len(some), np.float32)
                self._nearness.extend(np.divide(1, np.sqrt(distances), out=here, where=apart))

    def row(self, references: Halves, starts: Indices, direction: Floats) -> Row:
        """Return the cosines (R,) of the first references in a direction."""
        row = products(references, direction)
        usual = (self._means.astype(np.float64) @ direction).astype(np.float32)
        row -= np.repeat(usual, np.diff(np.minimum(starts, len(row)), append=len(row)))
        row *= self._nearness.view[: len(row)]
        return row


def sums_of(references: Halves) -> Doubles:
    """Return the sums of the numbers of global descriptors, and of their squares, (2, n)."""
    sums = np.zeros((2, references.shape[1]))
    for some in widened(references):
        squares = np.einsum('ij,ij->j', some, some, dtype=np.float64)
        sums += np.array([some.sum(axis=0, dtype=np.float64), squares])
    return sums


def usual_of(sums: Doubles, count: int) -> Usual:
    """Return what is usual of so many global descriptors, by `sums_of` them; of none as well."""
    if not count:
        numbers = sums.shape[1]
        return Usual(np.zeros(numbers, np.float32), np.ones(numbers, np.float32))
    mean, square = sums / count
    variance = np.maximum(square - mean**2, COARSE.least)
    variance = count * variance + COARSE.prior * variance.mean()
    variance = (variance / (count + COARSE.prior)).astype(np.float32)
    return Usual(mean.astype(np.float32), variance)


class DriveMean:
    """What the global descriptors of a drive usually are; takes it off those of its frames."""

    def __init__(self, numbers: int) -> None:
        self._numbers = numbers
        self.reset()

    def reset(self) -> None:
        self._sums, self._frames = np.zeros((2, self._numbers)), 0

    def update(self, descriptor: Descriptor, usual: Usual) -> Floats:
        """Take in a query, each once; return its direction among what is usual of the map."""
        query = vector_of(descriptor).astype(np.float32)
        self._sums += np.array([query, query.astype(np.float64) ** 2])
        self._frames += 1
        total, squares = self._sums
        past = total + COARSE.prior_frames * usual.mean
        away = query - past / (self._frames + COARSE.prior_frames)
        # Of the drive, so many times; how often makes no difference to a direction.
        variance = squares - total**2 / self._frames + COARSE.prior * usual.variance
        return usual.direction(away, variance)


@constants
class TRACK:
    """Of the sums along the way; by recall of the right place on drawn and real sets."""

    memory: float = 0.8  # of what a place's predecessors have, per keyframe
    reach: int = 3  # places that a drive may pass in a keyframe


class Coarse:
    """
    What names the places that a query may show: all of them, as the paper does (III-D).

    Others name those that are likely, of one map or of many shards.
    """

    _usable = 0

    def reset(self) -> None: ...

    def update(self, _descriptor: Descriptor, usable: int) -> None:
        """Take in a query, each once, and how many of the first references it may show."""
        self._usable = usable

    def best(self, _along: int, _newest: int, _passed: Sequence[range] = ()) -> Indices:
        """
        Return the likeliest places, ascending, none of those to be passed over.

        So many by the drive up to the newest query, and so many by that query alone.
        """
        return np.arange(self._usable)


class Track:
    """
    Sums of coarse scores along the way that a drive may have come, one for each place.

    A place has its own score, and of what the best of the places just before it had, most. So one
    pass over the row finds what a sequence finds, at all velocities up to `reach`; in `both`
    directions those just after it count as well. Sums stay within a session.
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

    The means of the session and of the drive are taken off: what night, season or the kind of
    surroundings does to every image counts for nothing. Numbers are divided by the fourth root of
    their standard deviation in both, as those that lamps change most would speak for all.
    """

    def __init__(self, reference_map: ReferenceMap, both: bool = False) -> None:
        self._map, self._track = reference_map, Track(both)
        self.row: Row = np.zeros(0, np.float32)  # cosines with the first references
        self._begin(reference_map.global_descriptors[:0])

    def _begin(self, nothing: Halves) -> None:
        """Know no place, of vectors of a length; that is told by the first of a model's."""
        numbers = nothing.shape[1]
        self._sums, self._counted = np.zeros((2, numbers)), 0
        self._usual, self._drive = usual_of(self._sums, 0), DriveMean(numbers)
        self._centred = Centred(self._usual, nothing, np.zeros(1, np.int64))

    def reset(self) -> None:
        self._drive.reset()
        self._track.reset()

    def update(self, descriptor: Descriptor, usable: int | None = None) -> None:
        """Take in a query, each once; `row` is then as long as what it may show."""
        references, starts = self._map.global_descriptors[:usable], self._map.bounds.starts
        if references.shape[1] != self._sums.shape[1]:
            self._begin(references[:0])
        self._follow_map(references, starts)
        direction = self._drive.update(descriptor, self._usual)
        self.row = self._centred.row(references, starts, direction)
        self._track.update(self.row, starts)

    def best(self, along: int, newest: int, passed: Sequence[range] = ()) -> Indices:
        """Return what `Coarse` says."""
        return np.union1d(top(self._track.sums, along, passed), top(self.row, newest, passed))

    def _follow_map(self, references: Halves, starts: Indices) -> None:
        if len(references) > COARSE.averaged_anew * self._counted:
            self._sums += sums_of(references[self._counted :])
            self._counted = len(references)
            self._usual = usual_of(self._sums, self._counted)
            self._centred = Centred(self._usual, references, starts)
        self._centred.follow(references, starts)


def top(scores: Row, count: int, passed: Sequence[range] = ()) -> Indices:
    """Return where the best so many scores are, the best first, none in what is passed over."""
    if passed:
        scores = scores.copy()
        for some in passed:
            scores[max(0, some.start) : max(0, some.stop)] = -np.inf
    if not count:
        return np.zeros(0, np.int64)
    groups = len(scores) // _GROUP
    if groups > count:
        # So many groups have a score that is no worse than this one.
        best = scores[: groups * _GROUP].reshape(_GROUP, groups).max(axis=0)
        likely = np.flatnonzero(scores >= np.partition(best, groups - count)[groups - count])
    else:
        likely = np.arange(len(scores))
    found = likely[np.argsort(-scores[likely], kind='stable')][:count]
    return found[np.isfinite(scores[found])]
