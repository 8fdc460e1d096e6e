# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Diagonals: the pairs that a sequence of frames meets along the map, and their sum (III-G)."""

from collections.abc import Sequence
from typing import Any

from convseq_ros.core.types import Indices, Row
import numpy as np
import numpy.typing as npt

Rows = Sequence[Row | None]  # newest first; None for an uninformative frame
Values = npt.NDArray[Any]


def diagonal(length: int, velocity: float = 1.0) -> list[int]:
    """Return how many references before its end a diagonal meets each frame, newest first."""
    return [int(offset * velocity + 0.5) for offset in range(length)]


def pairs_along(rows: Rows, ends: Indices, steps: Sequence[int], dtype: Any = None) -> Values:
    """Return the pair scores (k, n) on diagonals, k steps each, by their ends; NaN for none."""
    met = ends - np.array(steps, np.int64)[:, None]
    pairs = np.full(met.shape, np.nan, dtype)
    for scores, row, indices in zip(pairs, rows, met, strict=True):
        if row is not None and len(row):
            scores[:] = row.take(indices, mode='clip')
            scores[(indices < 0) | (indices >= len(row))] = np.nan
    return pairs


def sequence_scores(
    rows: Rows,
    velocity: float = 1.0,
    ends: Indices | None = None,
    dtype: type[np.floating] = np.float64,
    partial: bool = False,
) -> Values:
    """
    Return how well a sequence of k frames matches each reference, (R,), or those at `ends`, (n,).

    The mean of pair scores along each diagonal (III-G), -inf where it leaves the map, the newest
    pair has no score, or less than half of the pairs have one. `velocity` is how many references
    pass while one frame does, 1 in the paper; `ends` are ascending; float32 as a `dtype` is faster
    where scores are only compared. If `partial`, up to half of the pairs may lie off the map or
    lack scores, and then count as the mean of their row's known ones: a place is found sooner
    after the start. ValueError if the newest frame has no scores; older rows may be shorter.
    """
    if rows[0] is None:
        raise ValueError('the newest frame of a sequence must be informative')
    steps, count = diagonal(len(rows), velocity), len(rows[0])
    if ends is not None and len(ends) < count:
        return _scores_at(ends, rows, steps, dtype, partial)
    informative, reach = sum(row is not None for row in rows), steps[-1]
    scores = np.full(count, -np.inf, dtype)
    if 2 * informative < len(rows):
        return scores
    if reach >= count:
        return _scores_at(np.arange(count), rows, steps, dtype, partial)
    total = np.zeros(count - reach, dtype)
    for step, row in zip(steps, rows, strict=True):
        if row is not None:
            met = row[reach - step : count - step]
            total[: len(met)] += met
            total[len(met) :] = np.nan
    scores[reach:] = total / informative
    # Those without a sum are few, or else `ends` are given.
    unknown = reach + np.flatnonzero(~np.isfinite(total))
    if partial:
        unknown = np.concatenate((np.arange(reach), unknown))
    scores[unknown] = _scores_at(unknown, rows, steps, dtype, partial, whole=True)
    return scores


def _scores_at(
    ends: Indices, rows: Rows, steps: list[int], dtype: Any, partial: bool, whole: bool = False
) -> Values:
    """Look every pair up; a row's expected score is that of these, or of the `whole` row."""
    pairs = pairs_along(rows, ends, steps, dtype)
    known = np.isfinite(pairs)
    number = known.sum(axis=0)
    scored = known[0] & (2 * number >= len(rows))
    expected: Values = np.zeros(len(rows), dtype)
    if not partial:
        scored &= ends >= steps[-1]
    else:
        number = np.full(len(ends), sum(row is not None for row in rows))
        expected = pairs.sum(axis=1, where=known) / np.maximum(known.sum(axis=1), 1)
        if whole:
            expected = np.array([_mean(row) for row in rows], dtype)
    total = np.where(known, pairs, expected[:, None]).sum(axis=0)
    return np.divide(total, number, out=np.full(len(ends), -np.inf, dtype), where=scored)


def _mean(row: Row | None) -> float:
    if row is None or not len(row):
        return 0.0
    mean = float(np.mean(row))
    if np.isfinite(mean):
        return mean
    known = row[np.isfinite(row)]
    return float(np.mean(known)) if len(known) else 0.0
