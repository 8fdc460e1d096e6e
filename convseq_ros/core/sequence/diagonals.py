# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Diagonals: the pairs that a sequence of frames meets along the map, and their sum (III-G)."""

from collections.abc import Sequence
from typing import Any

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


def sequence_scores(
    rows: Rows,
    ends: Indices | None = None,
    partial: bool = False,
    bounds: SessionBounds = ONE_SESSION,
) -> Values:
    """
    Return how well a sequence of k frames matches each reference, (R,), or those at `ends`, (n,).

    The mean of pair scores along each diagonal (III-G), -inf where it leaves its session, the
    newest pair has no score, or less than half of the pairs have one; `ends` are ascending. If
    `partial`, up to half of the pairs may lie off the session or lack scores, and then count as
    the mean of their row's known ones: a place is found sooner after the start. ValueError if the
    newest frame has no scores; older rows may be shorter. Those of a whole map are float32.
    """
    if rows[0] is None:
        raise ValueError('the newest frame of a sequence must be informative')
    every = np.arange(len(rows[0]))
    ends = every if ends is None else ends
    dtype: Any = np.float32 if len(ends) == len(every) else np.float64
    firsts, stops = bounds.spans(ends)
    total, known = np.zeros(len(ends), dtype), np.zeros(len(ends), dtype)
    scored = partial | (ends - len(rows) + 1 >= firsts)
    for age, row in enumerate(rows):
        if row is None or not len(row):
            continue
        met = ends - age
        pairs = row.take(met, mode='clip')
        there = (met >= firsts) & (met < np.minimum(stops, len(row))) & np.isfinite(pairs)
        total += np.where(there, pairs, mean_score(row) if partial else np.float32(0))
        known += there
        if not age:
            scored &= there
    scored &= 2 * known >= len(rows)
    number = dtype(sum(row is not None for row in rows)) if partial else known
    return np.divide(total, number, out=np.full(len(ends), -np.inf, dtype), where=scored)


def mean_score(row: Row) -> np.float32:
    """Return the mean of what is known of a row, 0 if nothing is."""
    mean = np.mean(row, dtype=np.float64) if len(row) else 0.0
    if not np.isfinite(mean):
        known = row[np.isfinite(row)]
        mean = np.mean(known, dtype=np.float64) if len(known) else 0.0
    return np.float32(mean)
