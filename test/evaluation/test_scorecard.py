# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a run of five frames, worked out by hand."""

from convseq_ros.evaluation.scorecard import (
    add_thresholds,
    decisions,
    figures,
    first_closures,
    Scorecard,
    Verdicts,
)
import numpy as np
import pytest


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
        },
    }
    return Verdicts(**(usual | changes))


def test_each_accuracy_has_its_own_denominator():
    found = figures(verdicts(), 'score')
    assert found['accuracy_matched'] == pytest.approx(2 / 3)
    assert found['accuracy_all'] == pytest.approx(2 / 4)


def test_recall_at_full_precision_is_among_the_matched_queries_that_have_an_answer():
    assert figures(verdicts(), 'score')['recall_at_100_precision'] == pytest.approx(1 / 3)
    assert figures(verdicts(), 'margin')['recall_at_100_precision'] == pytest.approx(2 / 3)


def test_the_area_counts_right_matches():
    found = figures(verdicts(), 'score')
    assert found['auc_pr'] == pytest.approx(1 / 2 * 1 + 1 / 2 * 2 / 4)


def test_decisions_are_counted_over_known_places():
    assert decisions(verdicts()) == {
        'accepted': 3,
        'accepted_right': 1,
        'false_closures': 1,
        'slips': 1,
        'accepted_recall': 1 / 4,
    }


def test_waits_for_the_first_right_closure_count_from_the_first_known_frame_of_each_half():
    assert first_closures(verdicts(), [''] * 5) == {'': 1}
    # The second half knows its first frame, whose answer is a slip, and no other.
    assert first_closures(verdicts(), ['first'] * 3 + ['last'] * 2) == {'first': 1, 'last': None}
    assert first_closures(verdicts(known=np.zeros(5, bool)), [''] * 5) == {}


def test_without_answers_there_are_no_figures():
    none = np.zeros(5, bool)
    found = figures(verdicts(known=none, correct=none, slip=none), 'score')
    assert set(found.values()) == {None}


def card(name, own):
    """Return what a method did on a set that has these verdicts."""
    return Scorecard({'method': 'net', 'set': name, 'protocol': 'open'}, own, [''] * 5)


def test_a_threshold_lets_through_what_beats_all_wrong_answers_here_or_everywhere():
    here = card('here', verdicts())
    values = {'score': np.array([np.nan, 0.9, 0.6, 0.5, 0.85])}
    unknown = dict.fromkeys(('margin', 'confidence'), np.full(5, np.nan))
    there = card('there', verdicts(values=values | unknown))
    other = card('other', verdicts())
    other.summary['method'] = 'another'
    add_thresholds([here, there, other])
    # By margin both right answers of `here` beat the wrong one, by score only one does.
    assert here.summary['own_threshold_by'] == 'margin'
    assert here.summary['own_threshold'] == 0.1
    assert here.summary['own_threshold_recall'] == 0.5
    assert here.summary['own_threshold_first'] == {'': 1}
    assert there.summary['own_threshold'] == 0.85
    for one in (here, there):
        assert one.summary['common_threshold'] == 0.85
        assert one.summary['common_threshold_by'] == 'score'
        assert one.summary['common_threshold_recall'] == 0.25
    assert other.summary['common_threshold'] == 0.1


def test_where_no_answer_is_wrong_everything_is_taken():
    sound = card('sound', verdicts(correct=np.array([0, 1, 1, 1, 1], bool)))
    add_thresholds([sound])
    assert sound.summary['own_threshold'] is None
    assert sound.summary['own_threshold_recall'] == 1
