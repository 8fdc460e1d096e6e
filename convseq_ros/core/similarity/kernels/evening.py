# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The evened cells of coherent matching, compiled."""

from convseq_ros.core.compiled import compiled
from convseq_ros.core.similarity.cell_normalization import Cells, MIDDLE, SATURATION, SIDE
import numpy as np


def evened(cells: Cells) -> Cells:
    """Return what the definition's `evened` does, to 1e-6."""
    found = np.empty_like(cells, order='C')
    # Given, for what is compiled is not made anew when another folder's constants change.
    middle, side, saturation = np.float32(MIDDLE), np.float32(SIDE), np.float32(SATURATION)
    _even(np.ascontiguousarray(cells), middle, side, saturation, found)
    return found


@compiled
def _even(cells, middle, side, saturation, found):  # type: ignore[no-untyped-def]
    """Fill in the evened cells."""
    size, _, bins = cells.shape
    above, across = np.empty(cells.shape, np.float32), np.empty(cells.shape, np.float32)
    for row in range(size):
        for column in range(size):
            least = cells[row, column, 0]
            for one in range(1, bins):
                least = min(least, cells[row, column, one])
            for one in range(bins):
                above[row, column, one] = cells[row, column, one] - least
    for row in range(size):
        for column in range(size):
            left, right = max(column - 1, 0), min(column + 1, size - 1)
            for one in range(bins):
                beside = above[row, left, one] + above[row, right, one]
                across[row, column, one] = middle * above[row, column, one] + side * beside
    total = np.float64(0)
    for row in range(size):
        upper, lower = max(row - 1, 0), min(row + 1, size - 1)
        for column in range(size):
            here = np.float32(0)
            for one in range(bins):
                beside = across[upper, column, one] + across[lower, column, one]
                number = middle * across[row, column, one] + side * beside
                found[row, column, one] = number
                here += number
            total += np.float64(here)
    usual = np.float32(saturation * total / cells.size)
    if usual > 0:
        flat = found.reshape(-1)
        for place in range(len(flat)):
            flat[place] /= flat[place] + usual
