# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coarse scores: how alike a query and all references are by their global descriptors."""

from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.regions import global_descriptor, unit
from convseq_ros.core.map.place import GrowingArray
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.kernels.numpy_halves import Floats, Halves, products, widened
from convseq_ros.core.types import Descriptor, Row
import numpy as np


@constants
class COARSE:
    """Of the whitening; chosen by recall on 14 sets, by day and darkened (docs/MATCHING.md)."""

    prior_frames: int = 2  # that the map's mean counts for in the drive's
    prior_of_variance: int = 20  # samples: places for the map's, frames for the drive's
    least_variance: float = 1e-6  # of a number; none is constant
    power: float = 1 / 8  # of a variance; 1/2 takes off all spread, and costs single frames by day
    averaged_anew: float = 1.02  # growth of the map after which its mean is taken anew
    least_distance: float = 1e-6  # squared, from the mean; nearer ones have no direction


class CoarseScores:
    """
    Scores a query against all references: 1.5 ms and 50 MB at 100,000, in proportion to the map.

    The means of the map and of the drive are taken off: what night or season does to every image
    counts for nothing. Numbers are divided by the fourth root of their standard deviation in both,
    as those that lamps change most would speak for all. Above a million references an index
    should answer instead, in rows that are NaN but for the references that it names.
    """

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map
        numbers = reference_map.global_descriptors.shape[1]
        self._sums, self._counted = np.zeros((2, numbers)), 0  # of numbers, and of their squares
        self._mean, self._variance = np.zeros(numbers, np.float32), np.ones(numbers, np.float32)
        self._nearness = GrowingArray(np.zeros(0, np.float32))  # inverse distances from the mean
        self.reset()

    def reset(self) -> None:
        self._own_sums, self._frames = np.zeros_like(self._sums), 0

    def update(self, descriptor: Descriptor, usable: int | None = None) -> Row:
        """Take in a query, each once; return its cosines, (usable,), with the first references."""
        references = self._map.global_descriptors[:usable]
        self._follow_map(references)
        query = global_descriptor(descriptor.cells).astype(np.float32)
        self._own_sums += np.array([query, query.astype(np.float64) ** 2])
        self._frames += 1
        total, squares = self._own_sums
        past = total + COARSE.prior_frames * self._mean
        away = query - past / (self._frames + COARSE.prior_frames)
        # Of the drive, so many times; how often makes no difference to a direction.
        variance = squares - total**2 / self._frames + COARSE.prior_of_variance * self._variance
        own = unit(away / variance**COARSE.power)
        direction = (own / self._variance**COARSE.power).astype(np.float32)
        row = products(references, direction)
        row -= np.float32(self._mean.astype(np.float64) @ direction)
        row *= self._nearness.view[: len(references)]
        return row

    def _follow_map(self, references: Halves) -> None:
        count = len(references)
        if count > COARSE.averaged_anew * self._counted:
            for some in widened(references[self._counted :]):
                squares = np.einsum('ij,ij->j', some, some, dtype=np.float64)
                self._sums += np.array([some.sum(axis=0, dtype=np.float64), squares])
            self._counted = count
            mean, square = self._sums / count
            variance = np.maximum(square - mean**2, COARSE.least_variance)
            variance = count * variance + COARSE.prior_of_variance * variance.mean()
            self._mean = mean.astype(np.float32)
            self._variance = (variance / (count + COARSE.prior_of_variance)).astype(np.float32)
            self._nearness = GrowingArray(self._inverse_distances(references))
        more = references[len(self._nearness) :]
        self._nearness.extend(self._inverse_distances(more))

    def _inverse_distances(self, references: Halves) -> Floats:
        inverse, weights = [np.zeros(0, np.float32)], self._variance ** (-2 * COARSE.power)
        for some in widened(references):
            distances = (some - self._mean).astype(np.float64) ** 2 @ weights
            apart, here = distances > COARSE.least_distance, np.zeros(len(some), np.float32)
            inverse.append(np.divide(1, np.sqrt(distances), out=here, where=apart))
        return np.concatenate(inverse)
