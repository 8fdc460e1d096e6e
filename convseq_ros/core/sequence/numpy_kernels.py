# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `kernels` computes, by NumPy: the oracle, and the fallback where nothing is compiled."""

from collections.abc import Iterator, Sequence
from typing import Any

from convseq_ros.core.types import Indices, Row
import numpy as np
import numpy.typing as npt

ONE = np.zeros(1, np.int64)  # session, which begins at 0


def peaks(
    rows: Sequence[Row | None], steps: npt.NDArray[np.intp], starts: Indices = ONE
) -> npt.NDArray[np.float64]:
    """
    Return the highest and the mean of a sequence's scores at each velocity, and their count.

    Parameters
    ----------
    rows : sequence of k ndarrays of float32, shape (R,), or None
        Pair scores, newest first, which is not None; NaN for none, older rows may be shorter.
    steps : ndarray of intp, shape (V, k)
        How many references before its end each diagonal meets each frame, newest first, or
        negative, how many after it.
    starts : ndarray of int64, shape (S,)
        Where sessions begin, ascending, the first at 0; no diagonal leaves its own.

    Returns
    -------
    ndarray of float64, shape (V, 3)
        Of the diagonals inside a session whose newest pair has a score, and half of all pairs; 0
        where there is none.

    """
    found = np.zeros((len(steps), 3))
    for velocity, own in enumerate(steps):
        scores = whole_scores(rows, own, starts)
        scores = scores[np.isfinite(scores)]
        if scores.size:
            found[velocity] = scores.max(), scores.mean(dtype=np.float64), scores.size
    return found


def whole_scores(
    rows: Sequence[Row | None], steps: npt.NDArray[np.intp], starts: Indices = ONE
) -> Row:
    """Return what `sequence_scores` does of whole windows, (R,), as `partial_scores` does."""
    return _in_order([_whole_scores(*part) for part in _parts(rows, steps, starts)], steps)


def _whole_scores(rows: Sequence[Row | None], steps: npt.NDArray[np.intp]) -> Row:
    newest, reach = rows[0], steps[-1]
    assert newest is not None
    found = np.full(len(newest), -np.inf, np.float32)
    if reach >= len(newest):
        return found
    total, known = np.zeros((2, len(newest) - reach), np.float32)
    for row, step in zip(rows, steps, strict=True):
        if row is not None:
            met = row[reach - step : len(newest) - step]
            there = np.isfinite(met)
            total[: len(met)] += np.where(there, met, np.float32(0))
            known[: len(met)] += there
    scored = np.isfinite(newest[reach:]) & (known > 0) & (2 * known >= len(rows))
    np.divide(total, known, out=found[reach:], where=scored)
    return found


def partial_scores(
    rows: Sequence[Row | None],
    steps: npt.NDArray[np.intp],
    starts: Indices = ONE,
    means: Sequence[Any] | None = None,
) -> Row:
    """
    Return what `sequence_scores` does of partial windows, (R,), for all references.

    Parameters
    ----------
    rows : sequence of k ndarrays of float32, shape (R,), or None
        As for `peaks`.
    steps : ndarray of intp, shape (k,)
        As one row of those of `peaks`.
    starts : ndarray of int64, shape (S,)
        As for `peaks`; the mean of a row is that of all sessions.
    means : sequence of k floats, optional
        Of the rows, if they are parts of longer ones.

    """
    if means is None:
        means = [0 if row is None else mean_score(row) for row in rows]
    parts = _parts(rows, steps, starts)
    return _in_order([_partial_scores(*part, means) for part in parts], steps)


def _parts(
    rows: Sequence[Row | None], steps: npt.NDArray[np.intp], starts: Indices
) -> Iterator[tuple[Sequence[Row | None], npt.NDArray[np.intp]]]:
    """Yield what each session has of rows, and steps; read from the end if steps are negative."""
    ends = [*starts[1:].tolist(), None]
    for start, end in zip(starts.tolist(), ends, strict=True):
        yield _ahead([None if row is None else row[start:end] for row in rows], steps)


def _in_order(found: Sequence[Row], steps: npt.NDArray[np.intp]) -> Row:
    """Return the scores of all sessions, in the order of the map."""
    return np.concatenate([scores[::-1] if steps[-1] < 0 else scores for scores in found])


def _ahead(
    rows: Sequence[Row | None], steps: npt.NDArray[np.intp]
) -> tuple[Sequence[Row | None], npt.NDArray[np.intp]]:
    """Return rows and steps; read from their ends if steps were negative."""
    newest = rows[0]
    assert newest is not None
    if steps[-1] >= 0:
        return rows, steps
    flipped: list[Row | None] = []
    for row in rows:
        whole = np.full(len(newest), np.nan, np.float32)
        if row is not None:
            whole[: len(row)] = row
        flipped.append(None if row is None else whole[::-1])
    return flipped, -steps


def _partial_scores(
    rows: Sequence[Row | None], steps: npt.NDArray[np.intp], means: Sequence[Any]
) -> Row:
    newest = rows[0]
    assert newest is not None
    total, known = np.zeros((2, len(newest)), np.float32)
    for row, mean, step in zip(rows, means, steps.tolist(), strict=True):
        if row is not None:
            met = total[step : step + len(row)]
            own = row[: len(met)]
            there = np.isfinite(own)
            total[:step] += mean
            met += np.where(there, own, mean)
            known[step : step + len(row)] += there
            total[step + len(row) :] += mean
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
