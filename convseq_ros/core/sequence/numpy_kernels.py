# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `kernels` computes, by NumPy: the oracle, and the fallback where nothing is compiled."""

from collections.abc import Iterator, Sequence
from typing import Any

from convseq_ros.core.types import Indices, Row
import numpy as np
import numpy.typing as npt

ONE = np.zeros(1, np.int64)  # session, which begins at 0
Sums = npt.NDArray[np.float32]  # (2, R), scores, 0 where there is none, and how many, 0 or 1


def whole_scores(
    rows: Sequence[Row | None], steps: npt.NDArray[np.intp], starts: Indices = ONE
) -> Row:
    """Return what `sequence_scores` does of whole windows, (R,), as `partial_scores` does."""
    parts = _parts(_sums(rows), steps, starts)
    return _in_order([_whole_scores(*part) for part in parts], steps)


def _sums(rows: Sequence[Row | None]) -> list[Sums | None]:
    """Return scores, and their counts, 0 and 0 where there is none; all rows of one length."""
    zero = np.float32(0)
    return [
        None if row is None else np.array((np.where(known := np.isfinite(row), row, zero), known))
        for row in _of_one_length(rows)
    ]


def _whole_scores(sums: Sequence[Sums | None], steps: npt.NDArray[np.intp]) -> Row:
    newest, reach = sums[0], steps[-1]
    assert newest is not None
    size = newest.shape[1]
    found = np.full(size, -np.inf, np.float32)
    if reach < size:
        total, known = both = np.zeros((2, size - reach), np.float32)
        for row, step in zip(sums, steps, strict=True):
            if row is not None:
                both += row[:, reach - step : size - step]
        scored = (newest[1, reach:] > 0) & (2 * known >= len(sums))
        np.divide(total, known, out=found[reach:], where=scored)
    return found


def partial_scores(
    rows: Sequence[Row | None], steps: npt.NDArray[np.intp], starts: Indices = ONE
) -> Row:
    """
    Return what `sequence_scores` does of partial windows, (R,), for all references.

    Parameters
    ----------
    rows : sequence of k ndarrays of float32, shape (R,), or None
        Pair scores, newest first, which is not None; NaN for none, older rows may be shorter.
    steps : ndarray of intp, shape (k,)
        How many references before its end the diagonal meets each frame, newest first, or
        negative, how many after it.
    starts : ndarray of int64, shape (S,)
        Where sessions begin, ascending, the first at 0; no diagonal leaves its own, and the mean
        of a row is that of all sessions.

    """
    means = [0 if row is None else mean_score(row) for row in rows]
    parts = _parts(_of_one_length(rows), steps, starts)
    return _in_order([_partial_scores(*part, means) for part in parts], steps)


def _of_one_length(rows: Sequence[Row | None]) -> list[Row | None]:
    """Return rows as long as the newest; older ones of a map that grows are shorter."""
    newest = rows[0]
    assert newest is not None
    nothing = np.full_like(newest, np.nan)
    return [None if row is None else np.append(row, nothing[len(row) :]) for row in rows]


def _parts(
    rows: Sequence[Row | Sums | None], steps: npt.NDArray[np.intp], starts: Indices
) -> Iterator[tuple[list[Any], npt.NDArray[np.intp]]]:
    """Yield what each session has of rows, and steps; from end to start if steps are negative."""
    ends = [*starts[1:].tolist(), None]
    ahead = slice(None, None, -1 if steps[-1] < 0 else 1)
    for start, end in zip(starts.tolist(), ends, strict=True):
        own = [None if row is None else row[..., start:end][..., ahead] for row in rows]
        yield own, abs(steps)


def _in_order(found: Sequence[Row], steps: npt.NDArray[np.intp]) -> Row:
    """Return the scores of all sessions, in the order of the map."""
    return np.concatenate([scores[::-1] if steps[-1] < 0 else scores for scores in found])


def _partial_scores(
    rows: Sequence[Row | None], steps: npt.NDArray[np.intp], means: Sequence[Any]
) -> Row:
    newest = rows[0]
    assert newest is not None
    total, known = np.zeros((2, len(newest)), np.float32)
    for row, mean, step in zip(rows, means, steps.tolist(), strict=True):
        if row is not None:
            own = row[: max(0, len(row) - step)]
            there = np.isfinite(own)
            total[:step] += mean
            total[step:] += np.where(there, own, mean)
            known[step:] += there
    frames = sum(row is not None for row in rows)
    scored = np.isfinite(newest) & (2 * known >= len(rows))
    return np.where(scored, total / np.float32(frames), np.float32(-np.inf))


def mean_score(row: Row) -> np.float32:
    """Return the mean of what is known of a row, 0 if nothing is."""
    mean = np.mean(row, dtype=np.float64) if len(row) else 0.0
    if not np.isfinite(mean):
        known = row[np.isfinite(row)]
        mean = np.mean(known, dtype=np.float64) if len(known) else 0.0
    return np.float32(mean)
