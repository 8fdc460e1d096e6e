# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Products of many rows of numbers in half precision with one: by NumPy, where not compiled."""

from collections.abc import Iterator

from convseq_ros.core.compiled import available
import numpy as np
import numpy.typing as npt

Halves = npt.NDArray[np.float16]
Floats = npt.NDArray[np.float32]

_AT_ONCE = 4096  # rows in float32, for 4 MB of memory


def products(rows: Halves, direction: Floats) -> Floats:
    """Return the products, in float32, of rows (R, n) and a direction (n,), shape (R,)."""
    if available():
        from convseq_ros.core.similarity.kernels import regions

        return regions.products(rows, direction)
    found = [some @ direction for some in widened(rows)]
    return np.concatenate(found) if found else np.zeros(0, np.float32)


def widened(rows: Halves) -> Iterator[Floats]:
    """Yield rows in float32, some at a time, as all of them would take as much memory again."""
    for start in range(0, len(rows), _AT_ONCE):
        yield rows[start : start + _AT_ONCE].astype(np.float32)
