# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whitening of global descriptors: the mean of their session, or drive, is subtracted.

This removes what night, season or surroundings do to every image.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from convseq_ros.core.compiled import Array, available, kernel, SIZE
from convseq_ros.core.encoding.first_stage import vector_of
from convseq_ros.core.encoding.regions import unit
from convseq_ros.core.map.arrays import GrowingArray
from convseq_ros.core.types import constants, Descriptor, Doubles, Floats, Halves, Indices, Row
import numpy as np

_AT_ONCE = 1024  # rows that are converted to float32 at once, for 1 MB of memory
_WHITENED_AT_ONCE = 256  # rows, for 2 MB; answers do not depend on it
_PADDED = 16  # the length of vectors is padded to a multiple of this
_products = kernel('products', Array('f2'), SIZE, SIZE, Array('f4'), Array('f4'))  # kernels.c


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


def widened(rows: Halves, at_once: int = _AT_ONCE) -> Iterator[Floats]:
    """Yield rows in float32, some at a time: all at once would need too much memory."""
    for start in range(0, len(rows), at_once):
        yield rows[start : start + at_once].astype(np.float32)


@constants
class COARSE:
    """The whitening; tuned by recall on 14 sets, by day and darkened (commit ad68631c)."""

    prior_frames: int = 2  # weight of the map's mean in the drive's mean, in frames
    # Weight of the prior in a session's mean and in all variances, in places or frames.
    prior: int = 20
    least: float = 1e-6  # least variance of a number, and least squared distance from the mean
    power: float = 1 / 8  # of a variance; 1/2 whitens fully, and costs single frames by day
    averaged_anew: float = 1.02  # growth of the map after which its mean is computed again


@dataclass(frozen=True, eq=False, slots=True)
class Statistics:
    """Mean and variance of each number of a map's global descriptors, (n,)."""

    mean: Floats
    variance: Floats


class WhitenedReferences:
    """References of a map, whitened: relative to the mean of their session."""

    def __init__(self, statistics: Statistics, references: Halves, starts: Indices) -> None:
        self._weights = statistics.variance ** (-2 * COARSE.power)
        self._means = np.tile(statistics.mean, (len(starts), 1))
        for mean, session in zip(self._means, np.split(references, starts[1:]), strict=True):
            offsets = sums_of(session)[0] - len(session) * statistics.mean.astype(np.float64)
            mean += offsets / (len(session) + COARSE.prior)
        self._map_mean, self._nearness = statistics.mean, GrowingArray(np.zeros(0, np.float32))
        self.follow(references, starts)

    def follow(self, references: Halves, starts: Indices) -> None:
        """Take in new references of (R, n); a new session starts with the map's mean."""
        new, first = len(starts) - len(self._means), len(self._nearness)
        self._means = np.append(self._means, np.tile(self._map_mean, (new, 1)), axis=0)
        ends = np.append(starts[1:], len(references))
        for session in np.flatnonzero(ends > first):
            new_rows = references[max(starts[session], first) : ends[session]]
            for part in widened(new_rows, _WHITENED_AT_ONCE):
                away = (part - self._means[session]).astype(np.float64)
                distances = away**2 @ self._weights
                differs, zeros = distances > COARSE.least, np.zeros(len(part), np.float32)
                self._nearness.extend(np.divide(1, np.sqrt(distances), out=zeros, where=differs))

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


def statistics_of(sums: Doubles, count: int) -> Statistics:
    """Return mean and variance of `count` global descriptors from `sums_of` them."""
    if not count:
        numbers = sums.shape[1]
        return Statistics(np.zeros(numbers, np.float32), np.ones(numbers, np.float32))
    mean, square = sums / count
    variance = np.maximum(square - mean**2, COARSE.least)
    variance = count * variance + COARSE.prior * variance.mean()
    variance = (variance / (count + COARSE.prior)).astype(np.float32)
    return Statistics(mean.astype(np.float32), variance)


class DriveMean:
    """The mean and variance of a drive's global descriptors, which whiten its frames."""

    def __init__(self, numbers: int) -> None:
        self._numbers = numbers
        self.reset()

    def reset(self) -> None:
        self._sums, self._frames = np.zeros((2, self._numbers)), 0

    def update(self, descriptor: Descriptor, statistics: Statistics) -> Floats:
        """Take in a query, each only once; return its whitened direction (n,)."""
        query = vector_of(descriptor).astype(np.float32)
        self._sums += np.array([query, query.astype(np.float64) ** 2])
        self._frames += 1
        total, squares = self._sums
        past = total + COARSE.prior_frames * statistics.mean
        away = query - past / (self._frames + COARSE.prior_frames)
        # The variance times the number of frames: the factor does not change a direction.
        variance = squares - total**2 / self._frames + COARSE.prior * statistics.variance
        whitened = unit(away / variance**COARSE.power)
        return np.asarray(whitened / statistics.variance**COARSE.power, np.float32)
