# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""References as a query is compared with them: seen from what their own session usually shows."""

from dataclasses import dataclass

from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.regions import unit
from convseq_ros.core.map.place import GrowingArray
from convseq_ros.core.sequence.diagonals import Values
from convseq_ros.core.similarity.kernels.numpy_halves import Floats, Halves, products, widened
from convseq_ros.core.types import Indices, Row
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
