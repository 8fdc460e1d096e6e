# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Diagonals: the pairs that a sequence of frames meets along the map, and their sum (III-G)."""

from collections.abc import Sequence
from typing import Any

from convseq_ros.core.compiled import available
from convseq_ros.core.map.place import SessionBounds
from convseq_ros.core.types import Indices, Row
import numpy as np
import numpy.typing as npt

Rows = Sequence[Row | None]  # newest first; None for an uninformative frame
Values = npt.NDArray[Any]
ONE_SESSION = SessionBounds()


def diagonal(length: int, velocity: float = 1.0) -> list[int]:
    """
    Return how many references before its end a diagonal meets each frame, newest first.

    Negative ones, after its end, where the drive goes through the map backwards.
    """
    steps = [int(offset * abs(velocity) + 0.5) for offset in range(length)]
    return steps if velocity > 0 else [-step for step in steps]


def pairs_along(
    rows: Rows,
    ends: Indices,
    steps: Sequence[int],
    dtype: Any = None,
    bounds: SessionBounds = ONE_SESSION,
) -> Values:
    """Return the pair scores (k, n) on diagonals, k steps each, by their ends; NaN for none."""
    met, (firsts, stops) = ends - np.array(steps, np.int64)[:, None], bounds.spans(ends)
    pairs = np.full(met.shape, np.nan, dtype)
    for scores, row, indices in zip(pairs, rows, met, strict=True):
        if row is not None and len(row):
            scores[:] = row.take(indices, mode='clip')
            stop = np.minimum(stops, len(row))
            scores[(indices < firsts) | (indices >= stop)] = np.nan
    return pairs


def sequence_scores(
    rows: Rows,
    velocity: float = 1.0,
    ends: Indices | None = None,
    partial: bool = False,
    bounds: SessionBounds = ONE_SESSION,
) -> Values:
    """
    Return how well a sequence of k frames matches each reference, (R,), or those at `ends`, (n,).

    The mean of pair scores along each diagonal (III-G), -inf where it leaves its session, the
    newest pair has no score, or less than half of the pairs have one. `velocity` is how many
    references pass while one frame does, 1 in the paper, negative where these go backwards;
    `ends` are ascending. If `partial`, up to half of the pairs may lie off the session or lack
    scores, and then count as the mean of their row's known ones, here or, where all references
    are asked for, of the whole row: a place is found sooner after the start. ValueError if the
    newest frame has no scores; older rows may be shorter.
    """
    if rows[0] is None:
        raise ValueError('the newest frame of a sequence must be informative')
    steps, every = diagonal(len(rows), velocity), np.arange(len(rows[0]))
    ends = every if ends is None else ends
    is_whole_map, means = len(ends) == len(every), None
    if is_whole_map and partial:
        means = np.array([0.0 if row is None else mean_score(row) for row in rows])
    if is_whole_map and available():
        from convseq_ros.core.sequence.kernels import scores_along

        return scores_along(rows, np.array(steps), bounds.starts, means)
    pairs = pairs_along(rows, ends, steps, np.float64, bounds)
    known = np.isfinite(pairs)
    number = known.sum(axis=0)
    scored = known[0] & (2 * number >= len(rows))
    expected = np.zeros(len(rows))
    if partial:
        number = np.full(len(ends), sum(row is not None for row in rows))
        expected = pairs.sum(axis=1, where=known) / np.maximum(known.sum(axis=1), 1)
        expected = expected if means is None else means
    else:
        oldest, (firsts, stops) = ends - steps[-1], bounds.spans(ends)
        scored &= (oldest >= firsts) & (oldest < np.minimum(stops, len(every)))
    total = np.where(known, pairs, expected[:, None]).sum(axis=0)
    return np.divide(total, number, out=np.full(len(ends), -np.inf), where=scored)


def mean_score(row: Row) -> np.float32:
    """Return the mean of what is known of a row, 0 if nothing is."""
    mean = np.mean(row, dtype=np.float64) if len(row) else 0.0
    if not np.isfinite(mean):
        known = row[np.isfinite(row)]
        mean = np.mean(known, dtype=np.float64) if len(known) else 0.0
    return np.float32(mean)
