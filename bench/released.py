# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the released script does, restated: its steps and its cost, not its text.

It describes an image by compiled gradient histograms and by scikit-image's entropy, and compares
it with one reference after another by one product of all their regions. To match a sequence of k
frames it describes all k of them again and repeats the row of comparisons k times.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt
from skimage.filters.rank import entropy
from skimage.morphology import disk

_SIDE_PX, _CELL_PX, _BINS = 512, 16, 8
_CELLS = _SIDE_PX // _CELL_PX
REGIONS = (_CELLS - 1) ** 2

Rows = npt.NDArray[np.float32]


def encode(gray: npt.NDArray[np.uint8]) -> tuple[Rows, Rows]:
    """
    Return the regions (961, 32) of an image, and which are salient, as numbers 0 or 1.

    Histograms are summed by NumPy, where the script uses compiled code of its own.
    """
    resized = cv2.resize(gray, (_SIDE_PX, _SIDE_PX))
    return _regions(_histograms(resized)), _salient(resized)


class ReleasedLoop:
    """Compares a query with one reference after another; scratch arrays are made once."""

    def __init__(self) -> None:
        self._products = np.empty((REGIONS, REGIONS), np.float32)
        self._best = np.empty(REGIONS, np.float32)
        self._weighted = np.empty(REGIONS, np.float32)

    def row(
        self, query: Rows, salient: Rows, references: Sequence[Rows]
    ) -> npt.NDArray[np.float32]:
        """
        Return the scores of a query and every reference.

        Parameters
        ----------
        query : ndarray of float32, shape (961, 32)
            All of its regions are compared, salient or not.
        salient : ndarray of float32, shape (961,)
            Weights of its regions.
        references : sequence of ndarray of float32, shape (961, 32)
            Their regions.

        """
        return np.array([self._score(query, salient, one) for one in references], np.float32)

    def _score(self, query: Rows, salient: Rows, reference: Rows) -> float:
        np.dot(query, reference.T, out=self._products)
        np.max(self._products, axis=1, out=self._best)
        np.multiply(self._best, salient, out=self._weighted)
        return float(np.sum(self._weighted) / np.sum(salient))


def frame_ms(encode_ms: float, pair_ms: float, references: int, length: int) -> float:
    """Return what the script needs for a frame, computed from the cost of its steps."""
    windows = max(references - length + 1, 0)
    return length * (encode_ms + windows * pair_ms)


def _histograms(resized: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    corrected = np.sqrt(resized / float(max(resized.max(), 1))) * 255
    gx = cv2.Sobel(corrected, cv2.CV_64F, 1, 0, ksize=5)
    gy = cv2.Sobel(corrected, cv2.CV_64F, 0, 1, ksize=5)
    strength = np.abs(0.5 * gx + 0.5 * gy)
    position = cv2.phase(gx, gy, angleInDegrees=True) / (360 / _BINS)
    lower = position.astype(np.int64)
    share = position - lower
    cell = np.arange(_SIDE_PX) // _CELL_PX
    place = (cell[:, None] * _CELLS + cell) * _BINS
    sums = np.zeros(_CELLS * _CELLS * _BINS)
    for bins, weight in ((lower, 1 - share), (lower + 1, share)):
        votes = (strength * weight).ravel()
        sums += np.bincount((place + bins % _BINS).ravel(), votes, len(sums))
    return sums.reshape(_CELLS, _CELLS, _BINS)


def _regions(cells: npt.NDArray[np.float64]) -> Rows:
    corners = cells[:-1, :-1], cells[:-1, 1:], cells[1:, :-1], cells[1:, 1:]
    joined = np.concatenate(corners, axis=2).reshape(REGIONS, -1)
    length = np.linalg.norm(joined, axis=1, keepdims=True)
    return (joined / np.where(length > 0, length, 1)).astype(np.float32)


def _salient(resized: npt.NDArray[np.uint8]) -> Rows:
    bits = entropy(cv2.resize(resized, (100, 100)), disk(5))
    bits = cv2.resize(bits, (_SIDE_PX, _SIDE_PX))
    found = np.zeros((_CELLS - 1, _CELLS - 1), np.float32)
    for row in range(_CELLS - 1):
        for column in range(_CELLS - 1):
            top, left = row * _CELL_PX, column * _CELL_PX
            part = bits[top : top + 2 * _CELL_PX, left : left + 2 * _CELL_PX]
            found[row, column] = np.sum(part) / (8 * part.size) >= 0.5
    return found.ravel()
