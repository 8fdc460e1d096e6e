# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exact figures of merit: every score is a threshold. None for what does not exist."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math

from convseq_ros.errors import load
import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
Values = npt.NDArray[np.float64]
EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0)  # of the confidence ranges
_RESAMPLES = 1000
_SEED = 0
_LEVEL = 0.95


@dataclass(frozen=True, slots=True)
class Curve:
    """Precision and recall of the answers at or above each of T thresholds, which fall."""

    precision: Values  # (T,)
    recall: Values  # (T,), rising; NaN without positives


def share(part: int, total: int) -> float | None:
    """Return part / total, or None if the total is 0."""
    return part / total if total else None


def precision_recall(correct: Flags, values: Values, positives: int | None = None) -> Curve:
    """
    Return the exact precision-recall curve, by scikit-learn.

    `correct` (M,) flags the right answers, `values` (M,) are the values to threshold. `positives`
    is the denominator of recall, by default the number of right answers.
    """
    right = int(correct.sum())
    total = right if positives is None else positives
    if not right:
        number = min(1, len(correct))
        return Curve(np.zeros(number), np.full(number, 0.0 if total else np.nan))
    metrics = load('sklearn.metrics', 'evaluation')
    context = load('sklearn', 'evaluation').config_context
    with context(assume_finite=True, skip_parameter_validation=True):
        curve = metrics.precision_recall_curve(correct, values)
    precision, recall = (column[-2::-1] for column in curve[:2])  # without the point at recall 0
    return Curve(precision, recall * right / total)


def average_precision(curve: Curve) -> float | None:
    """Return the area under the stepped curve, AUC-PR; None without positives."""
    if not _has_recall(curve):
        return None
    return float(np.sum(np.diff(curve.recall, prepend=0.0) * curve.precision))


def recall_at_full_precision(curve: Curve) -> float | None:
    """Return the highest recall of a threshold without wrong answers; None without positives."""
    if not _has_recall(curve):
        return None
    return float(curve.recall[curve.precision == 1.0].max(initial=0.0))


def highest_wrong(correct: Flags, values: Values) -> float:
    """Return the highest value of a wrong answer; -inf if no answer is wrong."""
    return float(values[~correct].max(initial=-math.inf))


def recall_at(scores: Values, right: Flags, counts: Sequence[int]) -> dict[int, float | None]:
    """
    Return the share of queries with a right reference among the N best, for each N in `counts`.

    Queries without a right reference do not count. At equal scores, wrong references rank before
    the right one.
    """
    answerable = right.any(axis=1)
    best_right = np.where(right, scores, -np.inf).max(axis=1, initial=-np.inf)
    rank = (~right & (scores >= best_right[:, None])).sum(axis=1)
    has_score = answerable & np.isfinite(best_right)
    return {n: share(int((has_score & (rank < n)).sum()), int(answerable.sum())) for n in counts}


def reliability(confidences: Values, right: Flags) -> list[dict[str, float]]:
    """
    Return how often each confidence range was right; empty ranges are left out.

    The range of a row is `low` to `high`; only the last range includes `high`. `said` is the mean
    confidence of its `count` answers. `right` is the share of right answers, slips included.
    """
    bins = np.clip(np.digitize(confidences, EDGES) - 1, 0, len(EDGES) - 2)
    return [
        {
            'low': EDGES[index],
            'high': EDGES[index + 1],
            'count': int((bins == index).sum()),
            'said': float(confidences[bins == index].mean()),
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

    `figures` computes named figures of the frames at given indices. Neighbouring frames are not
    independent, so a block has sqrt(count) frames, or `block`. The result is reproducible.
    """
    if not count:
        return {}
    block = min(block or max(1, round(count**0.5)), count)
    generator = np.random.default_rng(_SEED)
    starts = generator.integers(0, count, (_RESAMPLES, -(-count // block)))
    chosen = (starts[:, :, None] + np.arange(block)).reshape(_RESAMPLES, -1)[:, :count] % count
    resampled = [figures(indices) for indices in chosen]
    tail = (1 - _LEVEL) / 2
    intervals = {}
    for name in resampled[0]:
        values = [sample[name] for sample in resampled if sample[name] is not None]
        if values:
            low, high = np.quantile(np.array(values, np.float64), (tail, 1 - tail))
            intervals[name] = (float(low), float(high))
    return intervals


def _has_recall(curve: Curve) -> bool:
    return len(curve.recall) > 0 and not np.isnan(curve.recall).any()
