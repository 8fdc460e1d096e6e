# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coarse scores: how alike a query and all references are by their global descriptors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import weakref

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.regions import global_descriptor, unit
from convseq_ros.core.map.place import GrowingArray
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.sequence.coarse_sums import all_sums, Asked, Sums
from convseq_ros.core.sequence.diagonals import Rows, Values
from convseq_ros.core.sequence.numpy_kernels import mean_score
from convseq_ros.core.similarity.kernels.numpy_halves import Floats, Halves, products, widened
from convseq_ros.core.types import Descriptor, Indices, Row
import numpy as np
import numpy.typing as npt


@constants
class COARSE:
    """Of the whitening; chosen by recall on 14 sets, by day and darkened (docs/MATCHING.md)."""

    prior_frames: int = 2  # that the map's mean counts for in the drive's
    prior_of_variance: int = 20  # samples: places for the map's, frames for the drive's
    prior_places: int = 20  # that the map's mean counts for in a session's
    least_variance: float = 1e-6  # of a number; none is constant
    power: float = 1 / 8  # of a variance; 1/2 takes off all spread, and costs single frames by day
    averaged_anew: float = 1.02  # growth of the map after which its mean is taken anew
    least_distance: float = 1e-6  # squared, from the mean; nearer ones have no direction


@dataclass(frozen=True, eq=False, slots=True)
class Usual:
    """What global descriptors of a map usually are: mean and variance of each number, (n,)."""

    mean: Floats
    variance: Floats

    def direction(self, away: npt.NDArray[np.float64], variance: Values) -> Floats:
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
            own += more / (len(session) + COARSE.prior_places)
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
                apart, here = distances > COARSE.least_distance, np.zeros(len(some), np.float32)
                self._nearness.extend(np.divide(1, np.sqrt(distances), out=here, where=apart))

    def row(self, references: Halves, starts: Indices, direction: Floats) -> Row:
        """Return the cosines (R,) of the first references in a direction."""
        row = products(references, direction)
        usual = (self._means.astype(np.float64) @ direction).astype(np.float32)
        row -= np.repeat(usual, _lengths(starts, len(row)))
        row *= self._nearness.view[: len(row)]
        return row


def _lengths(starts: Indices, count: int) -> Indices:
    """Return how many of the first references are of each session."""
    return np.diff(np.minimum(starts, count), append=count)


def sums_of(references: Halves) -> npt.NDArray[np.float64]:
    """Return the sums of the numbers of global descriptors, and of their squares, (2, n)."""
    sums = np.zeros((2, references.shape[1]))
    for some in widened(references):
        squares = np.einsum('ij,ij->j', some, some, dtype=np.float64)
        sums += np.array([some.sum(axis=0, dtype=np.float64), squares])
    return sums


def usual_of(sums: npt.NDArray[np.float64], count: int) -> Usual:
    """Return what is usual of so many global descriptors, by `sums_of` them; of none as well."""
    if not count:
        numbers = sums.shape[1]
        return Usual(np.zeros(numbers, np.float32), np.ones(numbers, np.float32))
    mean, square = sums / count
    variance = np.maximum(square - mean**2, COARSE.least_variance)
    variance = count * variance + COARSE.prior_of_variance * variance.mean()
    variance = (variance / (count + COARSE.prior_of_variance)).astype(np.float32)
    return Usual(mean.astype(np.float32), variance)


class DriveMean:
    """What the global descriptors of a drive usually are; takes it off those of its frames."""

    def __init__(self, numbers: int) -> None:
        self._numbers = numbers
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._sums, self._frames = np.zeros((2, self._numbers)), 0

    def update(self, descriptor: Descriptor, usual: Usual) -> Floats:
        """Take in a query, each once; return its direction among what is usual of the map."""
        query = global_descriptor(descriptor.cells).astype(np.float32)
        self._sums += np.array([query, query.astype(np.float64) ** 2])
        self._frames += 1
        total, squares = self._sums
        past = total + COARSE.prior_frames * usual.mean
        away = query - past / (self._frames + COARSE.prior_frames)
        # Of the drive, so many times; how often makes no difference to a direction.
        variance = squares - total**2 / self._frames + COARSE.prior_of_variance * usual.variance
        return usual.direction(away, variance)


class CoarseScores:
    """
    Scores a query against all references: 1.5 ms and 50 MB at 100,000, in proportion to the map.

    The means of the session and of the drive are taken off: what night, season or the kind of
    surroundings does to every image counts for nothing. Numbers are divided by the fourth root of
    their standard deviation in both, as those that lamps change most would speak for all. Indices
    were measured: up to a million references they lose more than they save (docs/FLEET.md).
    """

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map
        numbers = reference_map.global_descriptors.shape[1]
        self._sums, self._counted = np.zeros((2, numbers)), 0
        self._usual, self._drive = usual_of(self._sums, 0), DriveMean(numbers)
        nothing = reference_map.global_descriptors[:0], np.zeros(1, np.int64)
        self._centred = Centred(self._usual, *nothing)
        self._means: dict[int, np.float32] = {}  # of rows that are there, by their identities

    def reset(self) -> None:
        self._drive.reset()

    def update(self, descriptor: Descriptor, usable: int | None = None) -> Row:
        """Take in a query, each once; return its cosines, (usable,), with the first references."""
        references, starts = self._map.global_descriptors[:usable], self._map.bounds.starts
        self._follow_map(references, starts)
        direction = self._drive.update(descriptor, self._usual)
        row = self._centred.row(references, starts, direction)
        self._means[id(row)] = mean_score(row)
        weakref.finalize(row, self._means.pop, id(row)).atexit = False
        return row

    def peaks(self, rows: Rows, steps: Values) -> Values:
        """Return what `kernels.peaks` does."""
        found: Values = kernels_of(__package__).peaks(rows, steps, self._map.bounds.starts)
        return found

    def sums(self, asked: Sequence[Asked]) -> list[Sums]:
        """Return all sums along diagonals."""
        bounds = self._map.bounds
        return [all_sums(one, bounds, [*map(self._mean, one.rows)]) for one in asked]

    def _mean(self, row: Row | None) -> np.float32 | None:
        known = self._means.get(id(row))
        return mean_score(row) if known is None and row is not None else known

    def expect(self, places: Callable[[], Indices]) -> None:
        """Do nothing: they are at hand."""

    def _follow_map(self, references: Halves, starts: Indices) -> None:
        if len(references) > COARSE.averaged_anew * self._counted:
            self._sums += sums_of(references[self._counted :])
            self._counted = len(references)
            self._usual = usual_of(self._sums, self._counted)
            self._centred = Centred(self._usual, references, starts)
        self._centred.follow(references, starts)
