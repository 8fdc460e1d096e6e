# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scores along diagonals, in C: kernels.c; `numpy_kernels` has the same."""

from collections.abc import Sequence
import ctypes
from typing import Any

from convseq_ros.core.compiled import address, array, kernel, SIZE
from convseq_ros.core.sequence.numpy_kernels import mean_score, ONE
from convseq_ros.core.types import Indices, Row
import numpy as np
import numpy.typing as npt

_SIZES = array(np.intp)
_ROWS = ctypes.c_void_p, _SIZES, _SIZES, array('f4'), array('i8')  # the last: session bounds
_scores_along = kernel('scores_along', *_ROWS, SIZE, SIZE, SIZE, SIZE, array('f4'))


def partial_scores(
    rows: Sequence[Row | None], steps: npt.NDArray[np.intp], starts: Indices = ONE
) -> Row:
    """Return what the twin of `numpy_kernels` does, to 1e-6."""
    there, shown, lengths = _shown(rows)
    expected = np.array([mean_score(row) for row in shown], np.float32)
    scores, fewest = np.empty(len(shown[0]), np.float32), -(-len(rows) // 2)
    given = _addresses(shown), lengths, steps[there], expected, _bounds(starts, lengths)
    _scores_along(*given, len(shown), fewest, 0, False, scores)
    return scores


def whole_scores(
    rows: Sequence[Row | None], steps: npt.NDArray[np.intp], starts: Indices = ONE
) -> Row:
    """Return what the twin of `numpy_kernels` does, to 1e-6."""
    there, shown, lengths = _shown(rows)
    scores, expected = np.empty(len(shown[0]), np.float32), np.zeros(len(shown), np.float32)
    given = _addresses(shown), lengths, steps[there], expected, _bounds(starts, lengths)
    _scores_along(*given, len(shown), -(-len(rows) // 2), int(steps[-1]), True, scores)
    return scores


def _shown(rows: Sequence[Row | None]) -> tuple[list[int], list[Row], npt.NDArray[np.intp]]:
    """Return which frames have rows, the rows, and their lengths."""
    there = [frame for frame, row in enumerate(rows) if row is not None]
    shown = [np.ascontiguousarray(row, np.float32) for row in rows if row is not None]
    return there, shown, np.array([len(row) for row in shown], np.intp)


def _addresses(rows: Sequence[Row]) -> Any:
    return (ctypes.c_void_p * len(rows))(*map(address, rows))


def _bounds(starts: Indices, lengths: npt.NDArray[np.intp]) -> Indices:
    """Return where sessions begin, and the last one ends, in the newest row."""
    return np.minimum(np.append(starts, lengths[0]), lengths[0])
