# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many frames are matched together, and how well they match (paper III-A, E, F, G)."""

from collections.abc import Callable, Sequence
from typing import Any

from convseq_ros.config import SequenceConfig
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

Row = npt.NDArray[np.float32]

BACKWARD = -1
FORWARD = 1


def choose_length(
    outward: Sequence[Descriptor],
    similarity: Callable[[Descriptor, Descriptor], float],
    config: SequenceConfig,
) -> int | None:
    """
    Return the length k of the sequence that starts at an anchor frame.

    The sequence grows while its outermost frame still overlaps the anchor (little information
    gain), then while it holds too little entropy.

    Parameters
    ----------
    outward : sequence of Descriptor
        The frames in order outward from the anchor, which is the first and informative.
    similarity : callable
        Pair score of two descriptors, in [0, 1].
    config : SequenceConfig
        Thresholds and bounds.

    Returns
    -------
    int or None
        None if more frames than given would be needed.

    Notes
    -----
    With the following departures from the paper: (1) information gain is read as the released
    script does, `similarity >= overlap_threshold` extends; (2) the shortest chosen length is 2;
    (3) online, the anchor is the newest frame and the sequence reads into the past (the paper's
    anchor is the oldest frame and needs up to 24 future ones); (4) uninformative frames are passed
    over.

    """
    available = len(outward)
    if config.fixed_length:
        return config.fixed_length if config.fixed_length <= available else None

    def overlaps(other: Descriptor) -> bool:
        return not other.informative or similarity(outward[0], other) >= config.overlap_threshold

    length = config.min_length
    while length < config.max_overlap_length and length <= available:
        if not overlaps(outward[length - 1]):
            break
        length += 1
    while length < config.max_length and length <= available:
        if mean_entropy(outward[:length]) > config.entropy_threshold:
            break
        length += 1
    return length if length <= available else None


def mean_entropy(frames: Sequence[Descriptor]) -> float:
    """Return the mean entropy of the informative ones among at least one such frame."""
    return float(np.mean([frame.entropy for frame in frames if frame.informative]))


def sequence_scores(
    rows: Sequence[Row | None],
    direction: int = BACKWARD,
    slope: float = 1.0,
    ends: npt.NDArray[np.int64] | None = None,
    dtype: type[np.floating] = np.float64,
    partial: bool = False,
) -> npt.NDArray[Any]:
    """
    Return how well a sequence of frames matches each reference, in order.

    Parameters
    ----------
    rows : sequence of k ndarrays of float32, shape (R,), or None
        Pair scores of the frames in order outward from the anchor, NaN where there is none; None
        for an uninformative frame. The anchor has a row. Others may be shorter, where the map has
        grown since: what they lack counts as NaN.
    direction : BACKWARD or FORWARD
        Whether the frames lie before or after the anchor.
    slope : float
        References that pass while one frame does; 1, one to one, in the paper.
    ends : ndarray of int64, shape (n,), optional
        The references to score, ascending; all R by default.
    dtype : type
        What is summed up in; float32 is faster where scores are only compared.
    partial : bool
        Whether a window may leave the map, or lack scores, for up to half of its pairs, which then
        count as the mean of their row's known scores; so a place is found sooner after the map is
        entered.

    Returns
    -------
    ndarray of `dtype`, shape (R,) or (n,)
        At each reference, the mean of the pair scores along the diagonal that ends (BACKWARD) or
        starts (FORWARD) there. -inf where the window leaves the map (unless `partial`), the
        reference itself has no score, or less than half of the window's pairs have one.

    """
    anchor_row = rows[0]
    if anchor_row is None:
        raise ValueError('the anchor of a sequence must be informative')
    steps = diagonal(len(rows), slope)
    if ends is not None and len(ends) < len(anchor_row):
        return _scores_at(ends, rows, steps, direction, dtype, partial)
    count, reach = len(anchor_row), steps[-1]
    scores = np.full(count, -np.inf, dtype)
    first, last = (reach, count) if direction == BACKWARD else (0, count - reach)
    informative = sum(row is not None for row in rows)
    if 2 * informative < len(rows):
        return scores
    if first >= last:
        return _scores_at(np.arange(count), rows, steps, direction, dtype, partial)
    total = np.zeros(last - first, dtype)
    for step, row in zip(steps, rows, strict=True):
        if row is not None:
            met = row[first + direction * step : last + direction * step]
            total[: len(met)] += met
            total[len(met) :] = np.nan
    scores[first:last] = total / informative
    # A sum is not a number where a pair has no score. Those are few, or else `ends` are given.
    unknown = first + np.flatnonzero(~np.isfinite(total))
    if partial:
        unknown = np.concatenate((np.arange(first), unknown, np.arange(last, count)))
    scores[unknown] = _scores_at(unknown, rows, steps, direction, dtype, partial, whole=True)
    return scores


def _scores_at(
    ends: npt.NDArray[np.int64],
    rows: Sequence[Row | None],
    steps: Sequence[int],
    direction: int,
    dtype: type[np.floating],
    partial: bool,
    whole: bool = False,
) -> npt.NDArray[Any]:
    """
    Return the scores of some references, for each of which every pair is looked up.

    The usual score of a row, for a partial window, is taken from the pairs that are looked up, or
    from the whole row.
    """
    met = ends + direction * np.array(steps)[:, None]
    pairs = np.full(met.shape, np.nan, dtype)
    for row, indices, scores in zip(rows, met, pairs, strict=True):
        if row is not None and len(row):
            scores[:] = row.take(indices, mode='clip')
    lengths = np.array([0 if row is None else len(row) for row in rows])[:, None]
    known = np.isfinite(pairs) & (met >= 0) & (met < lengths)
    number = known.sum(axis=0)
    scored = known[0] & (2 * number >= len(rows))
    usual: npt.NDArray[Any] = np.zeros(len(rows), dtype)
    if partial:
        seen = pairs.sum(axis=1, where=known)
        usual = seen / np.maximum(known.sum(axis=1), 1)
        if whole:
            usual = np.array([_mean(row) for row in rows], dtype)
        number = np.full(len(ends), sum(row is not None for row in rows))
    else:
        scored &= (met[-1] >= 0) & (met[-1] < lengths[0])
    total = np.where(known, pairs, usual[:, None]).sum(axis=0)
    return np.divide(total, number, out=np.full(len(ends), -np.inf, dtype), where=scored)


def _mean(row: Row | None) -> float:
    if row is None or not len(row):
        return 0.0
    mean = float(np.mean(row))
    if np.isfinite(mean):
        return mean
    known = row[np.isfinite(row)]
    return float(np.mean(known)) if len(known) else 0.0


def diagonal(length: int, slope: float = 1.0) -> list[int]:
    """Return how many references before its end a diagonal meets each frame, newest first."""
    return [int(offset * slope + 0.5) for offset in range(length)]
