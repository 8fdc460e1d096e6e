# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of merit and scorecards, by hand, as properties, and against scikit-learn."""

from dataclasses import replace

from convseq_ros.core.types import Candidate, Match, Reason
from convseq_ros.evaluation.given_scores import PairScores
from convseq_ros.evaluation.metrics import (
    average_precision,
    block_intervals,
    highest_wrong,
    precision_recall,
    recall_at,
    recall_at_full_precision,
    reliability,
)
from convseq_ros.evaluation.protocols import Outcome
from convseq_ros.evaluation.scorecard import (
    CRITERIA,
    curve_figures,
    decisions,
    difference,
    first_closures,
    judge,
    ranked,
    shares,
    summarize,
    threshold_figures,
    Verdicts,
)
from hypothesis import given, settings, strategies
import numpy as np
import pytest

pytest.importorskip('sklearn', reason='needs scikit-learn')


def figures(found, criterion):
    return shares(found) | curve_figures(found, criterion)


def flags(*values):
    return np.array(values, bool)


def numbers(*values):
    return np.array(values, float)


def test_without_answers_the_curve_is_empty_and_has_no_figures():
    curve = precision_recall(flags(), numbers())
    assert len(curve.recall) == 0
    assert average_precision(curve) is None
    assert recall_at_full_precision(curve) is None


answers = strategies.lists(
    strategies.tuples(strategies.booleans(), strategies.integers(0, 6)), min_size=1, max_size=40
)


@settings(deadline=None)
@given(answers)
def test_the_threshold_above_all_wrong_answers_gives_full_precision(given_answers):
    correct, values = (np.array(column) for column in zip(*given_answers, strict=True))
    values = values.astype(float)
    taken = values > highest_wrong(correct, values)
    assert correct[taken].all()
    recall = recall_at_full_precision(precision_recall(correct, values))
    if recall is not None:
        assert recall == pytest.approx(taken.sum() / correct.sum())


@settings(deadline=None)
@given(answers)
def test_the_curve_has_a_point_for_each_distinct_value(given_answers):
    correct, values = (np.array(column) for column in zip(*given_answers, strict=True))
    if not correct.any():
        return
    curve = precision_recall(correct, values.astype(float), 50)
    taken = [values >= one for one in sorted({*values.tolist()}, reverse=True)]
    assert curve.precision.tolist() == pytest.approx([correct[one].mean() for one in taken])
    assert curve.recall.tolist() == pytest.approx([correct[one].sum() / 50 for one in taken])


@pytest.mark.parametrize(
    ('scores', 'right', 'expected'),
    [
        (
            [[0.9, 0.8, 0.7], [0.1, 0.9, 0.5], [-np.inf, -np.inf, 0.3]],
            [[0, 0, 1], [0, 1, 0], [1, 0, 0]],
            {1: 1 / 3, 2: 1 / 3, 3: 2 / 3},
        ),
        ([[0.5, 0.5]], [[1, 0]], {1: 0, 2: 1}),  # ties count against the method
        # Queries without a right reference do not count.
        ([[1, 0], [1, 0]], [[1, 0], [0, 0]], {1: 1}),
        ([[1, 0], [1, 0]], [[0, 0], [0, 0]], {1: None}),
    ],
)
def test_recall_at_n_counts_wrong_references_before_the_best_right_one(scores, right, expected):
    assert recall_at(np.array(scores), np.array(right, bool), (*expected,)) == expected


def test_each_range_of_confidence_has_a_count_and_a_share_of_right_answers():
    table = reliability(numbers(0.5, 0.41, 0.99, 1.0), flags(1, 0, 1, 1))
    assert table == [
        {'low': 0.4, 'high': 0.6, 'count': 2, 'said': pytest.approx(0.455), 'right': 0.5},
        {'low': 0.99, 'high': 1.0, 'count': 2, 'said': pytest.approx(0.995), 'right': 1.0},
    ]


def mean_of(values):
    return lambda chosen: {'mean': float(values[chosen].mean())}


def test_an_interval_holds_the_figure_and_is_the_same_at_every_call():
    values = np.random.default_rng(1).random(200) < 0.8
    low, high = block_intervals(200, mean_of(values))['mean']
    assert low < values.mean() < high
    assert block_intervals(200, mean_of(values)) == {'mean': (low, high)}
    assert block_intervals(5, lambda _: {'none': None, 'one': 1.0}) == {'one': (1.0, 1.0)}
    assert block_intervals(0, mean_of(values)) == {}


def test_blocks_of_one_frame_give_the_textbook_interval():
    low, high = block_intervals(400, mean_of(np.arange(400) % 2), block=1)['mean']
    assert abs((high - low) - 2 * 1.96 * 0.5 / 20) < 0.02


def verdicts(**changes):
    """Return five frames: skipped, right, right, slipped, wrong; the last is not in the map."""
    usual = {
        'matched': np.array([0, 1, 1, 1, 1], bool),
        'known': np.array([1, 1, 1, 1, 0], bool),
        'correct': np.array([0, 1, 1, 0, 0], bool),
        'slip': np.array([0, 0, 0, 1, 0], bool),
        'accepted': np.array([0, 1, 0, 1, 1], bool),
        'lengths': np.array([0, 2, 2, 3, 3]),
        'values': {
            'score': np.array([np.nan, 0.9, 0.6, 0.8, 0.7]),
            'margin': np.array([np.nan, 0.3, 0.2, np.nan, 0.1]),
            'confidence': np.full(5, np.nan),
            'accepted': np.array([np.nan, 0.9, np.nan, 0.8, 0.7]),
        },
    }
    return Verdicts(**(usual | changes))


def test_figures_of_five_frames_are_those_worked_by_hand():
    found = figures(verdicts(), 'score')
    assert found['accuracy_matched'] == pytest.approx(2 / 3)
    assert found['accuracy_all'] == pytest.approx(2 / 4)
    assert found['auc_pr'] == pytest.approx(1 / 2 * 1 + 1 / 2 * 2 / 4)
    # Among the matched queries that have an answer.
    assert found['recall_at_100_precision'] == pytest.approx(1 / 3)
    assert figures(verdicts(), 'margin')['recall_at_100_precision'] == pytest.approx(2 / 3)
    # At a recall of 100 % all four answers are taken, and two are right.
    assert found['precision_at_100_recall'] == 2 / 4
    assert decisions(verdicts()) == {
        'accepted': 3,
        'accepted_right': 1,
        'false_closures': 1,
        'slips': 1,
        'accepted_recall': 1 / 4,
    }


def test_a_refused_answer_is_found_at_no_threshold():
    right = np.array([0, 1, 1, 1, 1], bool)
    found = figures(verdicts(correct=right, known=right), 'accepted')
    assert found['recall_at_100_precision'] == found['auc_pr'] == 3 / 4


def test_the_first_closure_is_counted_from_the_first_known_frame_of_a_half():
    assert first_closures(verdicts(), [''] * 5) == {'': 1}
    # The second half knows its first frame, whose answer is a slip, and no other.
    assert first_closures(verdicts(), ['first'] * 3 + ['last'] * 2) == {'first': 1, 'last': None}
    assert first_closures(verdicts(known=np.zeros(5, bool)), [''] * 5) == {}


def test_without_answers_or_a_criterion_that_the_method_has_there_are_no_figures():
    found = figures(verdicts(), 'confidence')
    assert found['auc_pr'] is None and found['recall_at_100_precision'] is None
    assert len(verdicts().curve('confidence', 1).recall) == 0
    none = np.zeros(5, bool)
    found = figures(verdicts(known=none, correct=none, slip=none), 'score')
    assert {*found.values()} == {None}


def outcome(matches, scores, right):
    count = len(right)
    slip, halves = np.zeros_like(right), [''] * len(matches)
    pairs = PairScores(np.zeros((count, 3), np.float32))
    return Outcome('closed', matches, scores, right, slip, halves, range(count), pairs, None, [])


def test_recall_at_1_is_that_of_the_answers_and_others_follow_by_sequence_score():
    candidates = tuple(Candidate(index, 0, 0.5) for index in (2, 0))
    answer = Match(0, 0, Reason.WEAK, candidates)
    nothing = Match(1, 0, Reason.UNINFORMATIVE)
    scores = np.array([[0.1, 0.9, 0.9, -np.inf], [0.9, 0.1, 0.1, 0.1]])
    right = np.array([[0, 1, 0, 0], [1, 0, 0, 0]], bool)
    ranks = ranked(outcome([answer, nothing], scores, right))
    assert np.argsort(-ranks[0], kind='stable').tolist() == [2, 0, 1, 3]
    assert recall_at(ranks, right, (1, 2, 3, 4)) == {1: 0, 2: 0, 3: 0.5, 4: 0.5}


def answered(right):
    """Return an outcome with right and wrong answers, as flags (Q,) say."""
    matches = [
        Match(at, 0, Reason.WEAK, (Candidate(0 if flag else 1, 0, 0.5),))
        for at, flag in enumerate(right)
    ]
    count = len(right)
    return outcome(matches, np.zeros((count, 3)), np.tile(np.array([1, 0, 0], bool), (count, 1)))


def over(right, first, known=None):
    """Return the difference of two methods whose answers are right or not, as flags (Q,) say."""
    one, other = answered(right), answered(first)
    if known is not None:
        one, other = (replace(made, right=made.right & known[:, None]) for made in (one, other))
    return tuple(difference(one, judge(one), judge(other)).values())


def test_a_difference_is_of_two_methods_on_the_same_frames():
    hard = np.random.default_rng(3).random(400) < 0.5
    # All that differs is every tenth frame, whatever is hard for both.
    better = hard | (np.arange(400) % 10 == 0)
    gain, low, high = over(better, hard)
    assert gain == (better & ~hard).sum() / 400
    assert 0 < low < gain < high < gain + 0.03
    assert over(hard, better) == pytest.approx((-gain, -high, -low))
    assert over(hard, hard) == (0, 0, 0)
    # Of the first half nothing is known, and it does not count.
    known = np.arange(400) >= 200
    assert over(better, hard, known)[0] == (better & ~hard)[200:].sum() / 200
    assert over(better, hard, np.zeros(400, bool)) == (None, None, None)


def test_intervals_take_a_frame_in_all_parts_of_the_map_at_once():
    once = answered(np.random.default_rng(2).random(60) < 0.5)
    matches, scores, truth = once.matches, once.sequence_scores, once.right
    thrice = replace(
        once,
        matches=matches * 3,
        sequence_scores=np.tile(scores, (3, 1)),
        right=np.tile(truth, (3, 1)),
        slip=np.zeros((180, 3), bool),
        halves=['a'] * 60 + ['b'] * 60 + ['c'] * 60,
    )
    one, three = (summarize(made, judge(made), 'score') for made in (once, thrice))
    for end in ('low', 'high'):
        assert three[f'accuracy_all_{end}'] == one[f'accuracy_all_{end}']
    none = judge(answered(np.zeros(60, bool)))
    assert difference(once, judge(once), none) == difference(
        thrice, judge(thrice), none.of(np.tile(np.arange(60), 3))
    )


def test_figures_are_zero_where_no_answer_is_right_though_one_exists():
    none = np.zeros(5, bool)
    for nothing in (verdicts(correct=none), verdicts(correct=none, matched=none)):
        assert figures(nothing, 'score')['auc_pr'] == 0
    assert figures(verdicts(correct=none), 'score')['precision_at_100_recall'] == 0
    found = figures(verdicts(correct=none, matched=none), 'score')
    assert found['precision_at_100_recall'] is None


def test_a_threshold_over_what_is_accepted_leaves_out_what_is_refused():
    reasons = Reason.ACCEPTED, Reason.WEAK, Reason.ACCEPTED, Reason.ACCEPTED
    matches = [
        Match(at, 0, reason, (Candidate(at % 2, 0, score),))
        for at, (reason, score) in enumerate(zip(reasons, (0.5, 0.9, 0.4, 0.3), strict=True))
    ]
    truth = np.tile(np.array([1, 0, 0], bool), (4, 1))
    found = judge(outcome(matches, np.zeros((4, 3)), truth))
    # The refused one is wrong, and has the highest score; the worst accepted one is wrong, too.
    figures_of = threshold_figures(found, [''] * 4)
    assert figures_of['own_threshold_by'] == 'accepted' and figures_of['own_threshold'] == 0.3
    assert figures_of['own_threshold_recall'] == 0.5


def test_the_threshold_accepts_the_answers_that_beat_all_wrong_ones():
    # By margin both right answers beat the wrong one, by score only one does.
    found = threshold_figures(verdicts(), [''] * 5)
    assert found == {
        'own_threshold': 0.1,
        'own_threshold_by': 'margin',
        'own_threshold_recall': 0.5,
        'own_threshold_first': {'': 1},
    }
    values = {'score': np.array([np.nan, 0.9, 0.6, 0.5, 0.85])}
    unknown = dict.fromkeys(('margin', 'confidence', 'accepted'), np.full(5, np.nan))
    found = threshold_figures(verdicts(values=values | unknown), [''] * 5)
    assert found['own_threshold'] == 0.85 and found['own_threshold_by'] == 'score'


@pytest.mark.parametrize(
    ('changes', 'recall'),
    [
        ({'values': dict.fromkeys(CRITERIA, np.full(5, np.nan))}, None),
        ({'correct': np.array([0, 1, 1, 1, 1], bool)}, 1),  # every answer is accepted
    ],
)
def test_without_values_or_wrong_answers_there_is_no_threshold(changes, recall):
    found = threshold_figures(verdicts(**changes), [''] * 5)
    assert len(found) == 4 and found['own_threshold'] is None
    assert found['own_threshold_recall'] == recall
