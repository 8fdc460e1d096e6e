# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coherent pair scores as fast as NumPy and OpenCV can: what compiled kernels must beat."""

from convseq_ros.core.similarity.coherent import CoherentQuery, SIGMA_CELLS
import cv2
import numpy as np
import numpy.typing as npt

_REACH = 6
_WINDOW = np.exp(-(np.arange(-_REACH, _REACH + 1) ** 2) / (2 * SIGMA_CELLS**2))

Regions = npt.NDArray[np.float32]


class TunedPair:
    """
    Scores one query against references, with everything prepared that can be.

    Nothing is allocated for the products; the best query region of each reference region is found
    by comparing with the maximum, which is faster than an arg maximum over columns.

    Parameters
    ----------
    query : CoherentQuery
        Its salient regions.

    """

    def __init__(self, query: CoherentQuery) -> None:
        side = query.side
        self._regions, self._span = query.regions, 2 * side - 1
        self._products = np.empty((len(query.index), side * side), np.float32)
        self._equal = np.empty(self._products.shape, np.bool_)
        self._back = np.empty(side * side, np.int64)
        # The vote of a pair of regions is the difference of two such numbers.
        every = np.arange(side * side)
        self._end = every // side * self._span + every % side
        self._start = self._end[query.index] - (side - 1) * (self._span + 1)

    def score(self, reference: Regions) -> float:
        """Return the score with the projected regions (N, 32) of a reference."""
        products = np.dot(self._regions, reference.T, out=self._products)
        there = products.argmax(axis=1)
        np.equal(products, products.max(axis=0), out=self._equal)
        rows, columns = np.divmod(np.flatnonzero(self._equal), products.shape[1])
        self._back[columns[::-1]] = rows[::-1]  # the first of equal ones stays
        size = self._span**2
        votes = np.bincount(self._end[there] - self._start, minlength=size)
        back = np.bincount(self._end - self._start[self._back], minlength=size)
        counted = votes + back * (len(there) / len(self._back))
        image = counted.reshape(self._span, self._span)
        peak = cv2.sepFilter2D(image, -1, _WINDOW, _WINDOW, borderType=cv2.BORDER_CONSTANT)
        return min(float(peak.max()) / (2 * len(there)), 1.0)
