# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sequences: how long they are (III-A, E, F), and what their diagonals along a map sum up to."""

from collections.abc import Callable, Sequence
from statistics import fmean
from typing import Any

from convseq_ros.config import SequenceConfig
from convseq_ros.core.graph.links import SessionBounds
from convseq_ros.core.types import Descriptor, Indices, Row
import numpy as np
import numpy.typing as npt

Rows = Sequence[Row | None]  # newest first; None for an uninformative frame
Values = npt.NDArray[Any]
ONE_SESSION = SessionBounds()


def choose_length(
    outward: Sequence[Descriptor],
    similarity: Callable[[Descriptor, Descriptor, float], float],
    config: SequenceConfig,
) -> int | None:
    """
    Return the length k of the sequence of frames outward from the first, the informative anchor.

    It grows while its outermost frame still overlaps the anchor (little information gain), by
    their pair score in [0, 1], then while it holds too little entropy. None is returned if that
    takes more frames than there are. `similarity` is told against what a score is compared.

    Notes
    -----
    With the following departures from the paper: (1) information gain is read as the released
    script does, `similarity >= overlap_threshold` extends; (2) the shortest chosen length is 2;
    (3) online, the anchor is the newest frame and the sequence reads into the past (the paper's
    anchor is the oldest frame and needs up to 24 future ones); (4) uninformative frames are passed
    over.

    """

    def overlaps(length: int) -> bool:
        other, least = outward[length - 1], config.overlap_threshold
        return not other.informative or similarity(outward[0], other, least) >= least

    available, length = len(outward), config.fixed_length or config.min_length
    if not config.fixed_length:
        while length < config.max_overlap_length and length <= available and overlaps(length):
            length += 1
        entropies = [one.entropy for one in outward[:length] if one.informative]
        while length < config.max_length and length <= available:
            if fmean(entropies) > config.entropy_threshold:
                break
            entropies += [one.entropy for one in outward[length : length + 1] if one.informative]
            length += 1
    return length if length <= available else None


def diagonal(length: int, velocity: float = 1.0) -> list[int]:
    """Return how far before its end, negative if after, a diagonal meets frames, newest first."""
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
