# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coarse scores: how alike a query and all references are by their global descriptors."""

from collections.abc import Callable, Sequence
import weakref

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.encoding.regions import global_descriptor
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.sequence.centred import Centred, COARSE, sums_of, Usual, usual_of
from convseq_ros.core.sequence.coarse_sums import all_sums, Asked, Sums
from convseq_ros.core.sequence.diagonals import Rows, Values
from convseq_ros.core.sequence.indexed import centred
from convseq_ros.core.sequence.numpy_kernels import mean_score
from convseq_ros.core.similarity.kernels.numpy_halves import Floats, Halves
from convseq_ros.core.types import Descriptor, Indices, Row
import numpy as np


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
    their standard deviation in both, as those that lamps change most would speak for all. If there
    are more references than `index_above`, and it is not 0, they must not grow, and an index names
    the likely ones (docs/FLEET.md).
    """

    def __init__(self, reference_map: ReferenceMap, index_above: int = 0) -> None:
        self._map, self._index_above = reference_map, index_above
        numbers = reference_map.global_descriptors.shape[1]
        self._sums, self._counted = np.zeros((2, numbers)), 0
        self._usual, self._drive = usual_of(self._sums, 0), DriveMean(numbers)
        nothing = reference_map.global_descriptors[:0], np.zeros(1, np.int64)
        self._centred = Centred(self._usual, *nothing)
        self._means: dict[int, np.float32] = {}  # of rows that are there, by their identities
        if index_above:  # which takes longer than a frame may
            self._follow_map(reference_map.global_descriptors, reference_map.bounds.starts)

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
            self._centred = centred(self._usual, references, starts, self._index_above)
        self._centred.follow(references, starts)
