# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `kernels` computes, by NumPy: the oracle, and the fallback where nothing is compiled."""

from collections.abc import Sequence

from convseq_ros.core.types import Row
import numpy as np
import numpy.typing as npt


def peaks(rows: Sequence[Row | None], steps: npt.NDArray[np.intp]) -> npt.NDArray[np.float64]:
    """
    Return the highest and the mean of a sequence's scores at each velocity, and their count.

    Parameters
    ----------
    rows : sequence of k ndarrays of float32, shape (R,), or None
        Pair scores, newest first, which is not None; NaN for none, older rows may be shorter.
    steps : ndarray of intp, shape (V, k)
        How many references before its end each diagonal meets each frame, ascending.

    Returns
    -------
    ndarray of float64, shape (V, 3)
        Of the diagonals inside the map whose newest pair has a score, and half of all pairs; 0
        where there is none.

    """
    newest, found = rows[0], np.zeros((len(steps), 3))
    assert newest is not None
    shown = [
        (frame, np.nan_to_num(row), np.isfinite(row))
        for frame, row in enumerate(rows)
        if row is not None
    ]
    for velocity, own in enumerate(steps.tolist()):
        count, reach = len(newest), own[-1]
        if reach >= count:
            continue
        total, known = np.zeros((2, count - reach), np.float32)
        for frame, row, there in shown:
            met = slice(reach - own[frame], count - own[frame])
            end = len(row[met])
            total[:end] += row[met]
            known[:end] += there[met]
        scored = np.isfinite(newest[reach:]) & (known > 0) & (2 * known >= len(rows))
        scores = total[scored] / known[scored]
        if scores.size:
            found[velocity] = scores.max(), scores.mean(dtype=np.float64), scores.size
    return found


def partial_scores(rows: Sequence[Row | None], steps: npt.NDArray[np.intp]) -> Row:
    """
    Return what `sequence_scores` does of partial windows, (R,), for all references.

    Parameters
    ----------
    rows : sequence of k ndarrays of float32, shape (R,), or None
        As for `peaks`.
    steps : ndarray of intp, shape (k,)
        As one row of those of `peaks`.

    """
    newest = rows[0]
    assert newest is not None
    total, known = np.zeros((2, len(newest)), np.float32)
    for row, step in zip(rows, steps.tolist(), strict=True):
        if row is not None:
            met = total[step : step + len(row)]
            own, mean = row[: len(met)], mean_score(row)
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
    mean = np.mean(row) if len(row) else np.float32(0)
    if np.isfinite(mean):
        return mean
    known = row[np.isfinite(row)]
    return np.mean(known) if len(known) else np.float32(0)
