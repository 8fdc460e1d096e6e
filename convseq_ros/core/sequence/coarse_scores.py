# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coarse scores: how alike a query and all references are by their global descriptors."""

from collections.abc import Iterator
from dataclasses import dataclass

from convseq_ros.core.encoding.regions import global_descriptor, unit
from convseq_ros.core.map.place import GrowingArray
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.sequence.diagonals import Row
from convseq_ros.core.similarity.kernels.instructions import float_tile
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

Halves = npt.NDArray[np.float16]
Floats = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class CoarseConstants:
    """Of the whitening; chosen by recall on 14 sets, by day and darkened (docs/MATCHING.md)."""

    prior_frames: int = 2  # that the map's mean counts for in the drive's
    prior_of_variance: int = 20  # samples: places for the map's, frames for the drive's
    least_variance: float = 1e-6  # of a number; none is constant
    power: float = 1 / 8  # of a variance; 1/2 takes off all spread, and costs single frames by day
    averaged_anew: float = 1.02  # growth of the map after which its mean is taken anew
    least_distance: float = 1e-6  # squared, from the mean; nearer ones have no direction
    widened_at_once: int = 4096  # references in float32, for 4 MB of memory


COARSE = CoarseConstants()


class CoarseScores:
    """
    Scores a query against all references, at the cost of one product each.

    The map's mean is taken from its references, and the mean of the query's own past from the
    query, so that what night or season does to every image counts for nothing. Each of the numbers
    is divided by the fourth root of its standard deviation, in the map and on the drive: in the
    dark, those that lamps change most would speak for all. The map may grow; its statistics are
    taken anew whenever it has grown by a fiftieth.

    Notes
    -----
    A row takes time and memory in proportion to the map: about 1.5 ms and 50 MB at 100,000
    references. Above about a million, an index over `ReferenceMap.global_descriptors` should
    answer instead, in rows that are NaN but for the references that it names.

    """

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map
        numbers = reference_map.global_descriptors.shape[1]
        self._total, self._squares = np.zeros(numbers), np.zeros(numbers)
        self._counted = 0
        self._mean, self._variance = np.zeros(numbers, np.float32), np.ones(numbers, np.float32)
        self._nearness = GrowingArray(np.zeros(0, np.float32))
        self.reset()
        # Compiles it, so that the first frame is not late.
        products(reference_map.global_descriptors[:0], self._mean)

    def reset(self) -> None:
        """Forget the drive."""
        self._own_total, self._own_squares = np.zeros((2, *self._total.shape))
        self._frames = 0

    def update(self, descriptor: Descriptor, usable: int | None = None) -> Row:
        """
        Take in a query, each frame once, and return its coarse scores: cosines, in [-1, 1].

        Of so many usable references from the first, (usable,); of all by default.
        """
        references = self._map.global_descriptors[:usable]
        self._follow_map(references)
        query = global_descriptor(descriptor.cells).astype(np.float32)
        self._own_total += query
        self._own_squares += query.astype(np.float64) ** 2
        self._frames += 1
        past = self._own_total + COARSE.prior_frames * self._mean
        away = query - past / (self._frames + COARSE.prior_frames)
        # Of the drive, so many times; how often makes no difference to a direction.
        variance = self._own_squares - self._own_total**2 / self._frames
        variance += COARSE.prior_of_variance * self._variance
        own = unit(away / variance**COARSE.power)
        direction = (own / self._variance**COARSE.power).astype(np.float32)
        row = products(references, direction)
        row -= self._mean @ direction
        row *= self._nearness.view[: len(references)]
        return row

    def _follow_map(self, references: Halves) -> None:
        """Learn the mean, and how far each reference is from it; `_nearness` is the inverse."""
        count = len(references)
        if count > COARSE.averaged_anew * self._counted:
            for some in _widened(references[self._counted :]):
                self._total += some.sum(axis=0, dtype=np.float64)
                self._squares += np.einsum('ij,ij->j', some, some, dtype=np.float64)
            self._counted = count
            mean = self._total / count
            variance = np.maximum(self._squares / count - mean**2, COARSE.least_variance)
            variance = count * variance + COARSE.prior_of_variance * variance.mean()
            self._mean = mean.astype(np.float32)
            self._variance = (variance / (count + COARSE.prior_of_variance)).astype(np.float32)
            self._nearness = GrowingArray(self._inverse_distances(references))
        more = references[len(self._nearness) :]
        self._nearness.extend(self._inverse_distances(more))

    def _inverse_distances(self, references: Halves) -> Floats:
        inverse = np.zeros(len(references), np.float32)
        weights = self._variance ** (-2 * COARSE.power)
        start = 0
        for some in _widened(references):
            distances = (some - self._mean) ** 2 @ weights
            apart = distances > COARSE.least_distance
            here = inverse[start : start + len(some)]
            np.divide(1, np.sqrt(distances), out=here, where=apart)
            start += len(some)
        return inverse


def products(rows: Halves, direction: Floats) -> Floats:
    """Return the products, in float32, of rows (R, n) and a direction (n,), shape (R,)."""
    tile = float_tile()
    if tile and len(direction) >= tile.lanes:
        from convseq_ros.core.similarity.kernels import halves

        return halves.products(rows, direction)
    found = [some @ direction for some in _widened(rows)]
    return np.concatenate(found) if found else np.zeros(0, np.float32)


def _widened(rows: Halves) -> Iterator[Floats]:
    """Yield rows in float32, some at a time, as all of them would take as much memory again."""
    for start in range(0, len(rows), COARSE.widened_at_once):
        yield rows[start : start + COARSE.widened_at_once].astype(np.float32)
