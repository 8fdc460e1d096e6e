# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Computes the figures of a summary from the answers of a method."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
import math
from typing import Any

from convseq_ros.core.types import Match
from convseq_ros.evaluation import metrics
from convseq_ros.evaluation.given_scores import SequenceScores
from convseq_ros.evaluation.protocols import Outcome
import numpy as np
import numpy.typing as npt

CRITERIA = ('score', 'margin', 'confidence', 'accepted')
RECALL_COUNTS = (1, 5, 10, 20)
Summary = dict[str, Any]


@dataclass(frozen=True)
class Verdicts:
    """The verdicts on M answers."""

    matched: metrics.Flags  # there is a best reference
    known: metrics.Flags  # there is a right reference
    correct: metrics.Flags  # the best reference is right
    slip: metrics.Flags  # the best reference is just outside the tolerance
    accepted: metrics.Flags  # the method accepted it
    lengths: npt.NDArray[np.int64]  # k; 0 where no length could be chosen
    # By criterion: score, margin, confidence, or the score of what was accepted; NaN where the
    # method has none.
    values: Mapping[str, metrics.Values]

    def curve(self, criterion: str, positives: int) -> metrics.Curve:
        """Return the curve over a criterion, of the answers that have a value of it."""
        values = self.values[criterion]
        ranked = self.matched & ~np.isnan(values)
        return metrics.precision_recall(self.correct[ranked], values[ranked], positives)

    def of(self, chosen: npt.NDArray[np.int64]) -> 'Verdicts':
        """Return the verdicts on the chosen frames, in this order, with repetitions."""
        flags = {
            item.name: getattr(self, item.name)[chosen]
            for item in fields(self)
            if item.name != 'values'
        }
        return Verdicts(**flags, values={name: item[chosen] for name, item in self.values.items()})

    def above(self, criterion: str, threshold: float) -> metrics.Flags:
        """Return which answers exceed a threshold."""
        return self.matched & (self.sure(criterion) > threshold)

    def sure(self, criterion: str) -> metrics.Values:
        """Return the values of a criterion, -inf where the method has none."""
        values = self.values[criterion]
        return np.where(np.isnan(values), -np.inf, values)


def margin(match: Match) -> float:
    """Return the score difference of the best two candidates; NaN with fewer."""
    if len(match.candidates) < 2:
        return float('nan')
    return match.candidates[0].score - match.candidates[1].score


def judge(outcome: Outcome) -> Verdicts:
    """Return the verdicts on all answers."""
    matches = outcome.matches
    best = np.array([match.best.reference_index if match.best else -1 for match in matches])
    matched = best >= 0
    index = np.arange(len(matches))
    scores = np.array([match.best.score if match.best else np.nan for match in matches])
    accepted = np.array([match.accepted is not None for match in matches], np.bool_)
    sure = [np.nan if match.confidence is None else match.confidence for match in matches]
    return Verdicts(
        matched=matched,
        known=np.asarray(outcome.right.any(axis=1)),
        correct=matched & outcome.right[index, best],
        slip=matched & outcome.slip[index, best] & ~outcome.right[index, best],
        accepted=accepted,
        lengths=np.array([match.sequence_length for match in matches], np.int64),
        values={
            'score': scores,
            'margin': np.array([margin(match) for match in matches]),
            'confidence': np.array(sure),
            'accepted': np.where(accepted, scores, np.nan),
        },
    )


def shares(verdicts: Verdicts) -> dict[str, float | None]:
    """
    Return the shares of right answers; None where a share is undefined.

    At a recall of 100 % every answer is taken.
    """
    right = int(verdicts.correct.sum())
    taken = int(verdicts.matched.sum()) if verdicts.known.any() else 0
    return {
        'accuracy_matched': metrics.share(right, int((verdicts.matched & verdicts.known).sum())),
        'accuracy_all': metrics.share(right, int(verdicts.known.sum())),
        'precision_at_100_recall': metrics.share(right, taken),
    }


def curve_figures(verdicts: Verdicts, criterion: str) -> dict[str, float | None]:
    """
    Return the figures of the curves; None where a figure is undefined.

    `auc_pr` is the area under the precision-recall curve of the matched frames, recall over the
    right matches, as in scikit-learn and VPR-Bench; 0 if no match is right. An answer without a
    value, such as a refused one of `accepted`, is found at no threshold.
    """
    answerable = int((verdicts.matched & verdicts.known).sum())
    right = int(verdicts.correct.sum())
    area = metrics.average_precision(verdicts.curve(criterion, right))
    is_zero = verdicts.known.any() and not right
    return {
        'auc_pr': 0.0 if is_zero else area,
        'recall_at_100_precision': metrics.recall_at_full_precision(
            verdicts.curve(criterion, answerable)
        ),
    }


def decisions(verdicts: Verdicts) -> dict[str, float | None]:
    """Return how many answers the method accepts, and how many of these are right."""
    right = verdicts.accepted & verdicts.correct
    slips = verdicts.accepted & verdicts.slip
    return {
        'accepted': int(verdicts.accepted.sum()),
        'accepted_right': int(right.sum()),
        'false_closures': int((verdicts.accepted & ~right & ~slips).sum()),
        'slips': int(slips.sum()),
        'accepted_recall': metrics.share(int(right.sum()), int(verdicts.known.sum())),
    }


def first_closures(
    verdicts: Verdicts, halves: Sequence[str], above: metrics.Flags | None = None
) -> dict[str, int | None]:
    """
    Return the number of frames from the first known frame to the first right closure, per half.

    `halves` (M,) names the kept part of the map. Closures are the accepted answers, or the flags
    `above` (M,). None without a right closure; a half without known frames is left out.
    """
    right = verdicts.correct & (verdicts.accepted if above is None else above)
    delays = dict[str, int | None]()
    for half in dict.fromkeys(halves):
        here = np.array([name == half for name in halves])
        known, closed = (np.flatnonzero(flags[here]) for flags in (verdicts.known, right))
        if len(known):
            delays[half] = int(closed[0] - known[0]) if len(closed) else None
    return delays


def threshold_figures(verdicts: Verdicts, halves: Sequence[str]) -> Summary:
    """
    Return the figures of the best threshold without a false closure, chosen on this set itself.

    The threshold is the highest value of a wrong best candidate, by the criterion with the
    greatest recall. The keys begin with `own_threshold`.
    """
    wrong = verdicts.matched & ~(verdicts.correct | verdicts.slip)
    names = 'own_threshold', 'own_threshold_by', 'own_threshold_recall', 'own_threshold_first'
    best: Summary = dict.fromkeys(names)
    for criterion in CRITERIA:
        if np.isnan(verdicts.values[criterion]).all():
            continue
        threshold = metrics.highest_wrong(~wrong, verdicts.sure(criterion))
        above = verdicts.above(criterion, threshold)
        right = int((above & verdicts.correct).sum())
        result: Summary = {
            'own_threshold': threshold if math.isfinite(threshold) else None,
            'own_threshold_by': criterion,
            'own_threshold_recall': metrics.share(right, int(verdicts.known.sum())),
            'own_threshold_first': first_closures(verdicts, halves, above),
        }
        if not best['own_threshold_by'] or (result['own_threshold_recall'] or 0) > (
            best['own_threshold_recall'] or 0
        ):
            best = result
    return best


def ranked(outcome: Outcome) -> SequenceScores:
    """
    Return scores (M, R) that rank the references; -inf where there is no rank.

    The candidates of an answer come first, in their order, then others by their sequence scores.
    """
    ranks = outcome.sequence_scores.copy()
    for row, match in zip(ranks, outcome.matches, strict=True):
        if not match.candidates:
            row[:] = -np.inf
        highest = row.max(initial=-np.inf)
        for candidate in reversed(match.candidates):
            highest = row[candidate.reference_index] = np.nextafter(highest, np.inf)
    return ranks


def _intervals(
    outcome: Outcome, figures: Callable[[npt.NDArray[np.int64]], Mapping[str, float | None]]
) -> dict[str, tuple[float, float]]:
    """Return 95 % intervals; `figures` gets the answers that a resample takes."""
    count = len(outcome.query)
    # The parts of a map are asked the same frames, so a frame is chosen in all of them.
    parts = range(0, len(outcome.matches), count)
    return metrics.block_intervals(
        count, lambda chosen: figures(np.concatenate([chosen + part for part in parts]))
    )


def difference(outcome: Outcome, verdicts: Verdicts, first: Verdicts) -> Summary:
    """
    Return how far `accuracy_all` is above that of the first method, and its 95 % interval.

    Both methods are resampled alike, so that what is hard for both does not widen the interval.
    """
    gain = verdicts.correct.astype(np.int64) - first.correct

    def figures(chosen: npt.NDArray[np.int64]) -> dict[str, float | None]:
        return {'': metrics.share(int(gain[chosen].sum()), int(first.known[chosen].sum()))}

    low, high = _intervals(outcome, figures).get('', (None, None))
    value = figures(np.arange(len(gain)))['']
    return {'difference': value, 'difference_low': low, 'difference_high': high}


def summarize(outcome: Outcome, verdicts: Verdicts, criterion: str) -> Summary:
    """Return every figure of one method on one set, with 95 % intervals of the shares."""
    lengths = verdicts.lengths[verdicts.lengths > 0]
    intervals = _intervals(outcome, lambda chosen: shares(verdicts.of(chosen)))
    recalls = metrics.recall_at(ranked(outcome), outcome.right, RECALL_COUNTS)
    counts = Counter(lengths.tolist())
    confidence = verdicts.values['confidence']
    rated = verdicts.matched & ~np.isnan(confidence)
    table = metrics.reliability(confidence[rated], (verdicts.correct | verdicts.slip)[rated])
    return {
        'protocol': outcome.protocol,
        'criterion': criterion,
        'queries': len(verdicts.matched),
        'known': int(verdicts.known.sum()),
        'matched': int(verdicts.matched.sum()),
        'matched_known': int((verdicts.matched & verdicts.known).sum()),
        'correct': int(verdicts.correct.sum()),
        **shares(verdicts),
        **curve_figures(verdicts, criterion),
        **{
            f'{name}_{end}': value
            for name, interval in intervals.items()
            for end, value in zip(('low', 'high'), interval, strict=True)
        },
        **{f'recall_at_{count}': value for count, value in recalls.items()},
        'recall_at_100_precision_by': {
            name: curve_figures(verdicts, name)['recall_at_100_precision']
            for name, values in verdicts.values.items()
            if not np.isnan(values).all()
        },
        **decisions(verdicts),
        'frames_to_first_closure': first_closures(verdicts, outcome.halves),
        'mean_k': float(lengths.mean()) if len(lengths) else None,
        'k_distribution': {str(length): counts[length] for length in sorted(counts)},
        'pairs_per_frame': float(np.mean([match.pairs_scored for match in outcome.matches])),
        'encode_ms': outcome.pairs.encode_ms,
        'frame_ms': outcome.frame_ms,
        'place_bytes': outcome.pairs.place_bytes,
        'calibration': {'as_shipped': table} if table else None,
    }
