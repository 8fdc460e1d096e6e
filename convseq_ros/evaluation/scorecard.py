# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From what a method said to the figures in its summary."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from convseq_ros.core.types import Match
from convseq_ros.evaluation.bootstrap import block_intervals
from convseq_ros.evaluation.metrics import (
    average_precision,
    Curve,
    precision_recall,
    recall_at,
    recall_at_full_precision,
    share,
)
from convseq_ros.evaluation.protocols import Outcome
import numpy as np
import numpy.typing as npt

CRITERIA = ('score', 'margin', 'confidence')
RECALL_COUNTS = (1, 5, 10, 20)
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Verdicts:
    """
    What is right and what is wrong, one entry for each of M answers.

    Parameters
    ----------
    matched : ndarray of bool, shape (M,)
        Whether there is a best reference at all.
    known : ndarray of bool
        Whether there is a right one.
    correct, slip : ndarray of bool
        Whether the best one is right, or the right place but a little off.
    accepted : ndarray of bool
        Whether the method stands by it.
    reach : ndarray of bool
        Whether the whole sequence of a right answer lies in the map.
    lengths : ndarray of int64
        k; 0 where none could be chosen.
    values : mapping of str to ndarray of float64
        How sure the method is, by criterion; NaN where it does not say.

    """

    matched: Flags
    known: Flags
    correct: Flags
    slip: Flags
    accepted: Flags
    reach: Flags
    lengths: npt.NDArray[np.int64]
    values: Mapping[str, npt.NDArray[np.float64]]

    def curve(self, criterion: str, positives: int | None = None) -> Curve:
        """Return the precision-recall curve over the matched frames."""
        return precision_recall(
            self.correct[self.matched], self.sure(criterion)[self.matched], positives
        )

    def taken(self, criterion: str, threshold: float) -> Flags:
        """Return which answers exceed a threshold."""
        return self.matched & (self.sure(criterion) > threshold)

    def of(self, chosen: npt.NDArray[np.int64]) -> 'Verdicts':
        """Return the verdicts on some frames, repeated if asked for more than once."""
        return Verdicts(
            self.matched[chosen],
            self.known[chosen],
            self.correct[chosen],
            self.slip[chosen],
            self.accepted[chosen],
            self.reach[chosen],
            self.lengths[chosen],
            {name: values[chosen] for name, values in self.values.items()},
        )

    def sure(self, criterion: str) -> npt.NDArray[np.float64]:
        """Return the values of a criterion, -inf where the method does not say."""
        values = self.values[criterion]
        return np.where(np.isnan(values), -np.inf, values)


def margin(match: Match) -> float:
    """Return by how much the best candidate beats its best rival; NaN without one."""
    if len(match.candidates) < 2:
        return float('nan')
    return match.candidates[0].score - match.candidates[1].score


def judge(outcome: Outcome) -> Verdicts:
    """Return the verdict on every answer."""
    matches = outcome.matches
    best = np.array([match.best.reference_index if match.best else -1 for match in matches])
    matched = best >= 0
    index = np.arange(len(matches))
    return Verdicts(
        matched=matched,
        known=np.asarray(outcome.right.any(axis=1)),
        correct=matched & outcome.right[index, best],
        slip=matched & outcome.slip[index, best] & ~outcome.right[index, best],
        accepted=np.array([match.accepted is not None for match in matches], np.bool_),
        reach=outcome.reach,
        lengths=np.array([match.sequence_length for match in matches], np.int64),
        values={
            'score': np.array([match.best.score if match.best else np.nan for match in matches]),
            'margin': np.array([margin(match) for match in matches]),
            'confidence': np.array(
                [np.nan if match.confidence is None else match.confidence for match in matches]
            ),
        },
    )


def figures(verdicts: Verdicts, criterion: str) -> dict[str, float | None]:
    """
    Return the figures that depend on the frames alone.

    Returns
    -------
    dict of str to float or None
        `accuracy_matched`: right ones among the queries that were matched and have an answer;
        `accuracy_all`: among all queries that have an answer, matched or not. `auc_pr`: area
        under the precision-recall curve of the matched frames, recall over the right matches, as
        scikit-learn and VPR-Bench count it; `auc_pr_known`: recall over the matched queries that
        have an answer. `recall_at_100_precision`: over the same queries.

    """
    answerable = int((verdicts.matched & verdicts.known).sum())
    right = int(verdicts.correct.sum())
    known_curve = verdicts.curve(criterion, answerable)
    return {
        'accuracy_matched': share(right, answerable),
        'accuracy_all': share(right, int(verdicts.known.sum())),
        'auc_pr': average_precision(verdicts.curve(criterion)),
        'auc_pr_known': average_precision(known_curve),
        'recall_at_100_precision': recall_at_full_precision(known_curve),
    }


def decisions(verdicts: Verdicts) -> dict[str, float | None]:
    """
    Return what the method's own decisions are worth.

    Returns
    -------
    dict of str to number or None
        `accepted`, of which `accepted_right`, `slips` and `false_closures`; `accepted_recall`:
        right ones among all queries that have an answer; `accepted_recall_in_reach`: among those
        whose whole sequence lies in the map, the others left out above and below.

    """
    right = verdicts.accepted & verdicts.correct
    slips = verdicts.accepted & verdicts.slip
    reach = int(verdicts.reach.sum())
    return {
        'accepted': int(verdicts.accepted.sum()),
        'accepted_right': int(right.sum()),
        'false_closures': int((verdicts.accepted & ~right & ~slips).sum()),
        'slips': int(slips.sum()),
        'accepted_recall': share(int(right.sum()), int(verdicts.known.sum())),
        'accepted_recall_in_reach': share(int((right & verdicts.reach).sum()), reach),
    }


def first_closures(
    verdicts: Verdicts, halves: Sequence[str], way: npt.ArrayLike | None = None
) -> dict[str, float | None]:
    """
    Return how far after its first known frame each run has its first right closure.

    Parameters
    ----------
    verdicts : Verdicts
        Of all M answers.
    halves : sequence of M str
        Which part of the map was kept; one run of Q frames each.
    way : array_like of shape (Q,), optional
        What is counted, such as metres; frames if left out.

    Returns
    -------
    dict of str to number or None
        One for every part of which a frame is known; None without a right closure.

    """
    right, waits = verdicts.accepted & verdicts.correct, dict[str, float | None]()
    for half in dict.fromkeys(halves):
        here = np.array([one == half for one in halves])
        known, found = (np.flatnonzero(flags[here]) for flags in (verdicts.known, right))
        at = np.arange(here.sum()) if way is None else np.asarray(way)
        if len(known):
            waits[half] = (at[found[0]] - at[known[0]]).item() if len(found) else None
    return waits


def summarize(outcome: Outcome, verdicts: Verdicts, criterion: str) -> dict[str, Any]:
    """Return every figure of one method on one set, with 95 % intervals of the main ones."""
    lengths = verdicts.lengths[verdicts.lengths > 0]
    intervals = block_intervals(
        len(verdicts.matched), lambda chosen: figures(verdicts.of(chosen), criterion)
    )
    recalls = recall_at(outcome.sequence_scores, outcome.right, RECALL_COUNTS)
    return {
        'protocol': outcome.protocol,
        'criterion': criterion,
        'queries': len(verdicts.matched),
        'known': int(verdicts.known.sum()),
        'matched': int(verdicts.matched.sum()),
        'matched_known': int((verdicts.matched & verdicts.known).sum()),
        'correct': int(verdicts.correct.sum()),
        **figures(verdicts, criterion),
        **{
            f'{name}_{end}': value
            for name, interval in intervals.items()
            for end, value in zip(('low', 'high'), interval, strict=True)
        },
        **{f'recall_at_{count}': value for count, value in recalls.items()},
        'recall_at_100_precision_by': {
            name: figures(verdicts, name)['recall_at_100_precision']
            for name, values in verdicts.values.items()
            if not np.isnan(values).all()
        },
        'in_reach': int(verdicts.reach.sum()),
        **decisions(verdicts),
        'frames_to_first_closure': first_closures(verdicts, outcome.halves),
        'metres_to_first_closure': None
        if outcome.way_m is None
        else first_closures(verdicts, outcome.halves, outcome.way_m),
        'mean_k': float(lengths.mean()) if len(lengths) else None,
        'k_distribution': dict(
            sorted(Counter(map(str, lengths.tolist())).items(), key=lambda item: int(item[0]))
        ),
        'pairs_per_frame': float(np.mean([match.pairs_scored for match in outcome.matches])),
        'encode_ms': outcome.pairs.encode_ms,
        'frame_ms': outcome.frame_ms,
        'pcu': None,
        'transferred': None,
    }
