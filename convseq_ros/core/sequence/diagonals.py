# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sequence scores: means of pair scores along diagonals (III-G)."""

from collections.abc import Sequence
from typing import Any

from convseq_ros.core.graph.session_bounds import SessionBounds
from convseq_ros.core.types import Indices, Row
import numpy as np
import numpy.typing as npt

Rows = Sequence[Row | None]  # newest first; None for an uninformative frame
Values = npt.NDArray[Any]
ONE_SESSION = SessionBounds()


def diagonal(length: int, velocity: float = 1.0) -> list[int]:
    """Return how many places before its end a diagonal meets each frame, newest first."""
    steps = [int(offset * abs(velocity) + 0.5) for offset in range(length)]
    return steps if velocity > 0 else [-step for step in steps]


def sequence_scores(
    rows: Rows, ends: Indices | None = None, bounds: SessionBounds = ONE_SESSION
) -> Values:
    """
    Return the scores of a sequence of k frames at each reference, (R,), or at `ends`, (n,).

    A score is the mean of the pair scores along a diagonal (III-G). It is -inf if the diagonal
    leaves its session, the newest pair is not scored, or fewer than half of the pairs are scored.
    `ends` are ascending. Raises ValueError if the newest frame has no scores. Older rows may be
    shorter.
    """
    if rows[0] is None:
        raise ValueError('the newest frame of a sequence must be informative')
    references = np.arange(len(rows[0]))
    ends = references if ends is None else ends
    dtype: Any = np.float32 if len(ends) == len(references) else np.float64
    firsts, stops = bounds.spans(ends)
    total, known = np.zeros(len(ends), dtype), np.zeros(len(ends), dtype)
    scored = ends - len(rows) + 1 >= firsts
    for age, row in enumerate(rows):
        if row is None or not len(row):
            continue
        met = ends - age
        pairs = row.take(met, mode='clip')
        is_known = (met >= firsts) & (met < np.minimum(stops, len(row))) & np.isfinite(pairs)
        total += np.where(is_known, pairs, np.float32(0))
        known += is_known
        if not age:
            scored &= is_known
    scored &= 2 * known >= len(rows)
    return np.divide(total, known, out=np.full(len(ends), -np.inf, dtype), where=scored)
