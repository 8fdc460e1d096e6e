# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which frames become references."""

from dataclasses import replace
import math

from convseq_ros.config import EncodingConfig, EVERY_FRAME, KeyframeConfig
from convseq_ros.core.encoding.descriptor import describe, nothing_seen
from convseq_ros.core.keyframes import KeyframeSelector
from convseq_ros.core.types import Pose
import numpy as np

BLANK = nothing_seen(EncodingConfig())


def by(**settings):
    return replace(EVERY_FRAME, **settings)


def noise(seed):
    return describe(np.random.default_rng(seed).integers(0, 256, (60, 80), np.uint8))


def test_every_frame_is_kept_if_asked_for_blank_ones_too():
    selector = KeyframeSelector(EVERY_FRAME)
    assert all(selector.wants(stamp, BLANK) for stamp in (0, 0, 1, 2))


def test_frames_are_kept_at_the_interval_asked_for():
    selector = KeyframeSelector(by(keyframe_interval_s=0.5))
    stamps = range(0, 2_000_000_000, 200_000_000)
    kept = [stamp // 10**8 for stamp in stamps if selector.wants(stamp, BLANK)]
    assert kept == [0, 6, 12, 18]


def test_a_clock_that_jumps_back_starts_anew():
    selector = KeyframeSelector(by(keyframe_interval_s=5))
    assert [selector.wants(stamp, BLANK) for stamp in (10**10, 0)] == [True, True]


def test_a_scene_that_did_not_change_is_left_out():
    selector = KeyframeSelector(KeyframeConfig())
    first, second = noise(0), noise(1)
    wanted = [selector.wants(index, each) for index, each in enumerate([first, first, second])]
    assert wanted == [True, False, True]


def test_blank_frames_are_left_out_when_the_scene_decides():
    assert not KeyframeSelector(KeyframeConfig()).wants(0, BLANK)


def at(x, turned_rad=0.0):
    return Pose((x, 0.0, 0.0), (0.0, 0.0, math.sin(turned_rad / 2), math.cos(turned_rad / 2)))


def test_by_odometry_frames_are_kept_at_the_way_asked_for_however_long_it_takes():
    selector = KeyframeSelector(by(keyframe_distance_m=1.0))
    way = [0.0, 0.6, 0.9, 1.1, 1.1, 1.1, 1.9, 2.2, 9.0]
    kept = [x for time, x in enumerate(way) if selector.wants(time, BLANK, at(x))]
    assert kept == [0.0, 1.1, 2.2, 9.0]


def test_turning_on_the_spot_makes_keyframes():
    selector = KeyframeSelector(by(keyframe_distance_m=1.0))
    turns = [0.0, 0.2, 0.4, 0.6, 0.8]
    assert [selector.wants(0, BLANK, at(0, turn)) for turn in turns] == [
        True,
        False,
        True,
        False,
        True,
    ]


def test_a_camera_that_is_a_little_early_now_and_then_keeps_its_rhythm():
    selector = KeyframeSelector(by(keyframe_interval_s=0.2))
    jitter_ms = np.random.default_rng(0).integers(-6, 7, 40)
    stamps = (np.arange(40) * 100 + jitter_ms) * 1_000_000
    kept = [index for index, stamp in enumerate(stamps) if selector.wants(int(stamp), BLANK)]
    assert kept == [*range(0, 40, 2)]


def test_a_frame_whose_pose_is_not_known_is_kept():
    selector = KeyframeSelector(by(keyframe_distance_m=1.0))
    poses = [None, at(0), None, at(0), at(0)]
    assert [selector.wants(0, BLANK, pose) for pose in poses] == [True, True, True, False, False]


def test_warming_up_is_no_keyframe():
    selector = KeyframeSelector(KeyframeConfig())
    selector.warm_up(noise(0))
    assert selector.wants(0, noise(0)) and not selector.wants(1, noise(0))


def test_a_frame_that_is_only_asked_about_is_no_keyframe():
    selector = KeyframeSelector(by(keyframe_interval_s=1.0))
    assert all(selector.is_due(0) for _ in range(3)) and selector.wants(0, BLANK)
    assert not selector.is_due(1)
    selector.reset()
    assert selector.is_due(1)
