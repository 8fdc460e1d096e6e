# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames that a steady stream lacks."""

from convseq_ros.core.sequence.pace import Pace
import numpy as np
import pytest

STEP_NS = 33_333_333


def missing(stamps_ns):
    pace = Pace()
    return [pace.missing(int(stamp_ns)) for stamp_ns in stamps_ns]


def test_a_steady_stream_lacks_nothing():
    assert missing(np.arange(50) * STEP_NS) == [0] * 50


def test_a_gap_is_counted_in_frames_once_the_pace_is_known():
    shown = [index for index in range(40) if index not in (3, 20, 30, 31)]
    counts = dict(zip(shown, missing(np.array(shown) * STEP_NS), strict=True))
    assert {index: count for index, count in counts.items() if count} == {21: 1, 32: 2}


@pytest.mark.parametrize('share', [0.1, 0.3, 0.5])
def test_the_pace_is_that_of_the_camera_though_many_frames_are_lost(share):
    shown = np.flatnonzero(np.random.default_rng(1).random(300) >= share)
    steps = np.diff(shown)
    assert missing(shown * STEP_NS)[30:] == (steps[29:] - 1).tolist()


def test_jitter_is_no_gap():
    stamps = (np.arange(60) + np.random.default_rng(2).uniform(-0.1, 0.1, 60)) * STEP_NS
    assert sum(missing(stamps)) == 0


def test_times_without_a_common_step_lack_nothing():
    stamps = np.cumsum(np.random.default_rng(3).uniform(1, 4, 80)) * STEP_NS
    assert sum(missing(stamps)) <= 2


def test_after_a_reset_the_pace_is_learnt_anew():
    pace = Pace()
    for index in range(20):
        pace.missing(index * STEP_NS)
    pace.reset()
    assert [pace.missing(index * 2 * STEP_NS) for index in range(20)] == [0] * 20


def test_equal_stamps_are_borne():
    assert missing([5] * 12) == [0] * 12


def missing_keyframes(shown, keyframes):
    """Return how many keyframes are missing before each keyframe that was shown."""
    pace, found = Pace(), {}
    for index in shown:
        pace.missing(index * STEP_NS)
        if index in keyframes:
            found[index] = pace.missing_keyframes()
    return found


def test_lost_frames_are_as_many_keyframes_if_each_is_one():
    shown = [index for index in range(60) if index not in (30, 31, 45)]
    found = missing_keyframes(shown, shown)
    assert {index: count for index, count in found.items() if count} == {32: 2, 46: 1}


def test_frames_lost_between_keyframes_are_none_and_long_gaps_are_several():
    shown = [index for index in range(120) if index not in (31, 32, *range(61, 80))]
    found = missing_keyframes(shown, range(0, 120, 5))
    assert {index: count for index, count in found.items() if count} == {80: 3}
