# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An array that grows by rows while others read it."""

from typing import Any

import numpy as np
import numpy.typing as npt

_GROWTH = 1.25
_FEWEST_ROWS = 64


class GrowingArray:
    """
    Rows that are appended by one thread; views that others took before stay as they are.

    Parameters
    ----------
    rows : ndarray, shape (n, ...)
        What is there at the start; not copied before the array grows.

    """

    def __init__(self, rows: npt.NDArray[Any]) -> None:
        self._rows = rows
        self._count = len(rows)

    def __len__(self) -> int:
        return self._count

    @property
    def view(self) -> npt.NDArray[Any]:
        """The rows so far; not to be written to."""
        return self._rows[: self._count]

    def append(self, row: npt.ArrayLike) -> None:
        """Add a row; at most one thread does so."""
        if self._count == len(self._rows):
            capacity = max(_FEWEST_ROWS, int(self._count * _GROWTH))
            larger = np.empty((capacity, *self._rows.shape[1:]), self._rows.dtype)
            larger[: self._count] = self._rows
            self._rows = larger
        self._rows[self._count] = row
        self._count += 1
