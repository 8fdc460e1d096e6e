# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exact figures of merit: every score is a threshold. None for what does not exist."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
Values = npt.NDArray[np.float64]
EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0)  # of ranges of confidences
_RESAMPLES = 1000
_SEED = 0
_LEVEL = 0.95


@dataclass(frozen=True, slots=True)
class Curve:
    """Precision and recall when everything from a threshold up is taken, T points."""

    threshold: Values  # (T,), falling
    precision: Values  # (T,)
    recall: Values  # (T,), rising; NaN if nothing is to be found


def share(part: int, whole: int) -> float | None:
    """Return part / whole, or None of nothing."""
    return part / whole if whole else None


def precision_recall(correct: Flags, values: Values, positives: int | None = None) -> Curve:
    """
    Return the exact precision-recall curve.

    `correct` (M,) says which answers are right, `values` (M,) how sure the method is; `positives`
    counts the right answers that are to be found, by default those among the M.
    """
    order = np.argsort(-values, kind='stable')
    falling = values[order]
    last_of_tie = np.flatnonzero(np.append(falling[1:] != falling[:-1], len(falling) > 0))
    right = np.cumsum(correct[order])[last_of_tie]
    whole = int(correct.sum()) if positives is None else positives
    recall = right / whole if whole else np.full(len(right), np.nan)
    return Curve(falling[last_of_tie], right / (last_of_tie + 1), recall)


def average_precision(curve: Curve) -> float | None:
    """Return the area under the curve as steps: mean precision over recall, AUC-PR."""
    if not _has_recall(curve):
        return None
    return float(np.sum(np.diff(curve.recall, prepend=0.0) * curve.precision))


def recall_at_full_precision(curve: Curve) -> float | None:
    """Return the recall that the strictest thresholds reach before the first wrong answer."""
    if not _has_recall(curve):
        return None
    return float(curve.recall[curve.precision == 1.0].max(initial=0.0))


def highest_wrong(correct: Flags, values: Values) -> float:
    """Return the value that only right answers exceed; -inf if no answer is wrong."""
    return float(values[~correct].max(initial=-math.inf))


def recall_at(scores: Values, right: Flags, counts: Sequence[int]) -> dict[int, float | None]:
    """
    Return for which share of the queries a right reference is among so many of the best.

    Queries without a right one do not count. Wrong references that score as much as the best right
    one come before it.
    """
    known = right.any(axis=1)
    best_right = np.where(right, scores, -np.inf).max(axis=1, initial=-np.inf)
    before = (~right & (scores >= best_right[:, None])).sum(axis=1)
    found = known & np.isfinite(best_right)
    return {
        count: share(int((found & (before < count)).sum()), int(known.sum())) for count in counts
    }


def reliability(said: Values, right: Flags) -> list[dict[str, float]]:
    """
    Return how often each range of confidences was right; empty ranges are left out.

    A row has `low` and `high`, the range, high included in the last one only; `count`; `said`, the
    mean confidence; and `right`, the share that showed the right place, slips included.
    """
    bins = np.clip(np.digitize(said, EDGES) - 1, 0, len(EDGES) - 2)
    return [
        {
            'low': EDGES[index],
            'high': EDGES[index + 1],
            'count': int((bins == index).sum()),
            'said': float(said[bins == index].mean()),
            'right': float(right[bins == index].mean()),
        }
        for index in range(len(EDGES) - 1)
        if (bins == index).any()
    ]


def block_intervals(
    count: int,
    figures: Callable[[npt.NDArray[np.int64]], Mapping[str, float | None]],
    block: int | None = None,
) -> dict[str, tuple[float, float]]:
    """
    Return 95 % confidence intervals by the circular block bootstrap (Politis and Romano 1992).

    `figures` gives figures of the frames with some indices. Neighbouring frames are not
    independent: blocks have sqrt(count) frames, or `block`. The same at every call.
    """
    if not count:
        return {}
    block = min(block or max(1, round(count**0.5)), count)
    generator = np.random.default_rng(_SEED)
    starts = generator.integers(0, count, (_RESAMPLES, -(-count // block)))
    chosen = (starts[:, :, None] + np.arange(block)).reshape(_RESAMPLES, -1)[:, :count] % count
    drawn = [figures(one) for one in chosen]
    tail = (1 - _LEVEL) / 2
    intervals = {}
    for name in drawn[0]:
        values = [one[name] for one in drawn if one[name] is not None]
        if values:
            low, high = np.quantile(np.array(values, np.float64), (tail, 1 - tail))
            intervals[name] = (float(low), float(high))
    return intervals


def _has_recall(curve: Curve) -> bool:
    return len(curve.recall) > 0 and not np.isnan(curve.recall).any()
