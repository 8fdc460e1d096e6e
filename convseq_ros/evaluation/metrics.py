# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Exact figures of merit: every score that occurs is a threshold, equal scores are one step.

A figure that does not exist, such as the recall of nothing, is None.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
Values = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Curve:
    """
    Precision and recall when everything from a threshold up is taken.

    Parameters
    ----------
    threshold, precision, recall : ndarray of float64, shape (T,)
        In order of falling threshold, so of rising recall; recall is NaN if nothing is to be
        found.

    """

    threshold: Values
    precision: Values
    recall: Values


def share(part: int, whole: int) -> float | None:
    """Return part / whole, or None of nothing."""
    return part / whole if whole else None


def precision_recall(correct: Flags, values: Values, positives: int | None = None) -> Curve:
    """
    Return the exact precision-recall curve.

    Parameters
    ----------
    correct : ndarray of bool, shape (M,)
        Which answers are right.
    values : ndarray of float64, shape (M,)
        How sure of each; higher is surer.
    positives : int, optional
        How many right answers there are to be found; by default, those among the M. With the
        number of all queries that have an answer, recall counts the missed ones too.

    Raises
    ------
    ValueError
        If the shapes differ or a value is NaN.

    """
    if correct.shape != values.shape or np.isnan(values).any():
        raise ValueError(f'expected two of one shape, no NaN: {correct.shape}, {values.shape}')
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


def recall_at(
    scores: Values, right: Flags, counts: Sequence[int] = (1, 5, 10, 20)
) -> dict[int, float | None]:
    """
    Return for how many queries a right reference is among the best few.

    Parameters
    ----------
    scores : ndarray of float64, shape (Q, R)
        Sequence scores; -inf where there is none.
    right : ndarray of bool, shape (Q, R)
        Which references are right.
    counts : sequence of int
        How many of the best to look at.

    Returns
    -------
    dict of int to float or None
        Share of the queries that have a right reference. Wrong references that score as much as
        the best right one count as before it.

    """
    known = right.any(axis=1)
    best_right = np.where(right, scores, -np.inf).max(axis=1, initial=-np.inf)
    before = (~right & (scores >= best_right[:, None])).sum(axis=1)
    found = known & np.isfinite(best_right)
    return {
        count: share(int((found & (before < count)).sum()), int(known.sum())) for count in counts
    }


def performance_per_compute_unit(
    precision_at_full_recall: float, encode_ms: float, slowest_encode_ms: float
) -> float:
    """
    Return PCU = P_R100 * log10(t_e_max / t_e + 9), as the CoHOG paper defines it.

    Parameters
    ----------
    precision_at_full_recall : float
        Share of the matched queries that are right when all answers are taken.
    encode_ms, slowest_encode_ms : float
        Encoding time of this method and of the slowest one in the comparison.

    """
    return precision_at_full_recall * math.log10(slowest_encode_ms / encode_ms + 9)


def _has_recall(curve: Curve) -> bool:
    return len(curve.recall) > 0 and not np.isnan(curve.recall).any()
