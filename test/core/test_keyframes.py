# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which frames become references."""

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.descriptor import describe, nothing_seen
from convseq_ros.core.keyframes import KeyframeSelector
import numpy as np

BLANK = nothing_seen(EncodingConfig())


def noise(seed):
    return describe(np.random.default_rng(seed).integers(0, 256, (60, 80), np.uint8))


def test_every_frame_is_kept_by_default_blank_ones_too():
    selector = KeyframeSelector(KeyframeConfig())
    assert all(selector.wants(stamp, BLANK) for stamp in (0, 0, 1, 2))


def test_frames_are_kept_at_the_interval_asked_for():
    selector = KeyframeSelector(KeyframeConfig(keyframe_interval_s=0.5))
    stamps = range(0, 2_000_000_000, 200_000_000)
    kept = [stamp // 10**8 for stamp in stamps if selector.wants(stamp, BLANK)]
    assert kept == [0, 6, 12, 18]


def test_a_clock_that_jumps_back_starts_anew():
    selector = KeyframeSelector(KeyframeConfig(keyframe_interval_s=5))
    assert [selector.wants(stamp, BLANK) for stamp in (10**10, 0)] == [True, True]


def test_a_scene_that_did_not_change_is_left_out():
    selector = KeyframeSelector(KeyframeConfig(keyframe_overlap=0.99))
    first, second = noise(0), noise(1)
    wanted = [selector.wants(index, each) for index, each in enumerate([first, first, second])]
    assert wanted == [True, False, True]


def test_blank_frames_are_left_out_when_the_scene_decides():
    assert not KeyframeSelector(KeyframeConfig(keyframe_overlap=0.9)).wants(0, BLANK)
