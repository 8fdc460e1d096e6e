# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a confidence of .9 is right nine times of ten, with settings from other places only."""

from collections.abc import Mapping, Sequence
from typing import Any

from convseq_ros.evaluation.scorecard import Verdicts
from convseq_ros.evaluation.transfer import Measured
import numpy as np
import numpy.typing as npt

EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0)
_LIMIT = 1e-6
_STEPS = 50
_SHRINKAGE = 1e-3

Values = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


def confidences(verdicts: Verdicts) -> tuple[Values, Flags]:
    """Return what a method says of its best candidates, and which show the right place."""
    said = verdicts.values['confidence']
    known = verdicts.matched & ~np.isnan(said)
    return said[known], (verdicts.correct | verdicts.slip)[known]


def fitted(said: Values, right: Flags) -> tuple[float, float]:
    """
    Return offset and slope of a logistic function of the log odds, by maximum likelihood.

    Parameters
    ----------
    said : ndarray of float64, shape (N,)
        Confidences in [0, 1].
    right : ndarray of bool, shape (N,)
        Which were right.

    Notes
    -----
    A belief that is too sure, or too timid, by some factor of its log odds is put right by it.

    """
    features = np.column_stack((np.ones(len(said)), _log_odds(said)))
    offset, slope = logistic_weights(features, right, np.array([0.0, 1.0]))
    return float(offset), float(slope)


def logistic_weights(features: Values, right: Flags, start: Values) -> Values:
    """Return the weights (n,) of features (N, n) in the log odds, by maximum likelihood."""
    weights = start.copy()
    for _ in range(_STEPS):
        chance = _logistic(features @ weights)
        gradient = features.T @ (right - chance) - _SHRINKAGE * (weights - start)
        curvature = (features.T * (chance * (1 - chance))) @ features
        step = np.linalg.solve(curvature + _SHRINKAGE * np.eye(len(start)), gradient)
        weights = weights + np.clip(step, -1.0, 1.0)
        if np.abs(step).max() < _LIMIT:
            break
    return weights


def adjusted(said: Values, offset: float, slope: float) -> Values:
    """Return confidences after a fit."""
    return _logistic(offset + slope * _log_odds(said))


def reliability(said: Values, right: Flags) -> list[dict[str, float]]:
    """
    Return how often each range of confidences was right; empty ranges are left out.

    Returns
    -------
    list of dict
        `low`, `high`: the range, high included in the last one only; `count`; `said`: mean
        confidence; `right`: share that showed the right place, slips included.

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


def calibration(own: Measured, all_sets: Sequence[Measured]) -> Mapping[str, Any]:
    """
    Return the reliability of a method's confidence on one set.

    Parameters
    ----------
    own : Measured
        The set that is reported.
    all_sets : sequence of Measured
        The same method on all sets, this one included.

    Returns
    -------
    dict
        `as_shipped`: with the confidence as it was said; `from_others`: after a fit on the other
        places, None if there is none; `others`: their sets. Empty if nothing was said.

    """
    said, right = confidences(own.verdicts)
    if not len(said):
        return {}
    found = [(one.set, *confidences(one.verdicts)) for one in all_sets if one.place != own.place]
    others = [(name, values, flags) for name, values, flags in found if len(values)]
    refitted = None
    if others:
        offset, slope = fitted(
            np.concatenate([values for _, values, _ in others]),
            np.concatenate([flags for _, _, flags in others]),
        )
        refitted = reliability(adjusted(said, offset, slope), right)
    return {
        'as_shipped': reliability(said, right),
        'from_others': refitted,
        'others': [name for name, _, _ in others],
    }


def pooled(tables: Sequence[Sequence[Mapping[str, float]]]) -> list[dict[str, float]]:
    """Return one reliability table of several, range by range."""
    rows: dict[float, list[Mapping[str, float]]] = {}
    for table in tables:
        for row in table:
            rows.setdefault(row['low'], []).append(row)
    together = []
    for low, alike in sorted(rows.items()):
        count = sum(row['count'] for row in alike)
        means = {
            name: sum(row['count'] * row[name] for row in alike) / count
            for name in ('said', 'right')
        }
        together.append({'low': low, 'high': alike[0]['high'], 'count': count, **means})
    return together


def _log_odds(said: Values) -> Values:
    bounded = np.clip(said, _LIMIT, 1 - _LIMIT)
    return np.log(bounded / (1 - bounded))


def _logistic(values: Values) -> Values:
    return 1.0 / (1.0 + np.exp(-np.clip(values, -500, 500)))
