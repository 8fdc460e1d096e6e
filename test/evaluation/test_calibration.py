# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How reliable a confidence is, and how two methods agree."""

from pathlib import Path

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.agreement import agreement
from convseq_ros.evaluation.calibration import adjusted, calibration, fitted, pooled, reliability
from convseq_ros.evaluation.run_folder import Run
from convseq_ros.evaluation.scorecard import Verdicts
from convseq_ros.evaluation.transfer import Measured
import numpy as np
import pytest


def verdicts(said, correct, slip=None):
    said, correct = np.array(said, float), np.array(correct, bool)
    every = np.ones(len(said), bool)
    slip = ~every if slip is None else np.array(slip, bool)
    lengths = np.ones(len(said), int)
    return Verdicts(every, every, correct, slip, every, every, lengths, {'confidence': said})


def drawn(seed, offset=0.0, slope=1.0, count=4000):
    """Return confidences, and answers as often right as a logistic function of them says."""
    generator = np.random.default_rng(seed)
    said = generator.uniform(0.02, 0.98, count)
    return said, generator.random(count) < adjusted(said, offset, slope)


def test_each_range_tells_how_many_and_how_often_right():
    table = reliability(np.array([0.5, 0.41, 0.99, 1.0]), np.array([1, 0, 1, 1], bool))
    assert table == [
        {'low': 0.4, 'high': 0.6, 'count': 2, 'said': pytest.approx(0.455), 'right': 0.5},
        {'low': 0.99, 'high': 1.0, 'count': 2, 'said': pytest.approx(0.995), 'right': 1.0},
    ]


def test_a_fit_finds_how_the_answers_were_drawn():
    assert fitted(*drawn(1)) == pytest.approx((0.0, 1.0), abs=0.1)
    assert fitted(*drawn(2, offset=-1.0, slope=2.0)) == pytest.approx((-1.0, 2.0), abs=0.15)


def test_a_fit_bears_answers_that_a_threshold_parts():
    said = np.linspace(0.01, 0.99, 50)
    offset, slope = fitted(said, said > 0.5)
    assert np.isfinite(offset) and slope > 1


def test_settings_come_from_the_other_places_only():
    sure = Measured('sure', 'here', verdicts(*drawn(3)))
    same = Measured('same', 'here', verdicts([0.9] * 9, [0] * 9))
    other = Measured('other', 'there', verdicts(*drawn(4, offset=-2.0)))
    found = calibration(sure, [sure, same, other])
    assert found['others'] == ['other']
    for row in found['as_shipped']:
        assert row['right'] == pytest.approx(row['said'], abs=0.1)
    assert all(row['right'] > row['said'] - 0.01 for row in found['from_others'])
    assert calibration(sure, [sure, same])['from_others'] is None


def test_a_slip_shows_the_right_place_and_silence_is_left_out():
    own = Measured('own', 'here', verdicts([0.7, 0.7, np.nan], [0, 0, 0], [1, 0, 1]))
    (row,) = calibration(own, [own])['as_shipped']
    assert (row['count'], row['right']) == (2, 0.5)
    silent = Measured('own', 'here', verdicts([np.nan], [1]))
    assert calibration(silent, [silent]) == {}


def test_tables_are_pooled_by_their_counts():
    first = reliability(np.full(3, 0.5), np.ones(3, bool))
    second = reliability(np.array([0.5, 0.7]), np.zeros(2, bool))
    middle, upper = pooled([first, second])
    assert (middle['count'], middle['right'], middle['said']) == (4, 0.75, 0.5)
    assert (upper['low'], upper['count'], upper['right']) == (0.6, 1, 0.0)


def run(*accepted):
    frames = [{'reference_index': '' if one is None else str(one)} for one in accepted]
    return Run('set', 'method', Path('method'), {}, frames)


def test_decisions_agree_if_both_refuse_or_accept_one_place():
    assert agreement(run(None, 5, 5, 5), run(None, 7, 8, None)) == 0.5
    with pytest.raises(ConvseqError, match='1 and 2 frames cannot be compared'):
        agreement(run(1), run(1, 2))
