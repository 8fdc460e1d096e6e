# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Intervals from blocks of neighbouring frames."""

from convseq_ros.evaluation.bootstrap import block_intervals
import numpy as np


def mean_of(values):
    return lambda chosen: {'mean': float(values[chosen].mean())}


def test_the_interval_of_a_constant_is_a_point():
    assert block_intervals(30, mean_of(np.ones(30))) == {'mean': (1.0, 1.0)}


def test_the_interval_holds_the_figure_and_is_the_same_at_every_call():
    values = np.random.default_rng(1).random(200) < 0.8
    low, high = block_intervals(200, mean_of(values))['mean']
    assert low < values.mean() < high
    assert block_intervals(200, mean_of(values)) == {'mean': (low, high)}


def test_errors_in_a_row_make_the_interval_wider_than_scattered_ones():
    together = np.repeat([1.0, 0.0, 1.0, 1.0], 50)
    widths = []
    for values in (together, np.random.default_rng(0).permutation(together)):
        low, high = block_intervals(200, mean_of(values))['mean']
        widths.append(high - low)
    assert widths[0] > 1.5 * widths[1]


def test_blocks_of_one_frame_give_the_textbook_interval():
    values = np.arange(400) % 2
    low, high = block_intervals(400, mean_of(values), block=1)['mean']
    assert abs((high - low) - 2 * 1.96 * 0.5 / 20) < 0.02


def test_a_block_is_a_run_of_frames_that_may_go_on_from_end_to_start():
    seen = []
    block_intervals(10, lambda chosen: seen.append(chosen) or {'n': 1.0}, block=5)
    for chosen in seen:
        steps = np.diff(chosen.reshape(2, 5), axis=1) % 10
        assert (steps == 1).all()


def test_a_figure_that_does_not_exist_has_no_interval():
    assert block_intervals(5, lambda _: {'none': None, 'one': 1.0}) == {'one': (1.0, 1.0)}
    assert block_intervals(0, lambda _: {'one': 1.0}) == {}
