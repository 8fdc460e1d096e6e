# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which frames are keyframes, and so become references."""

from dataclasses import replace
import math

from convseq_ros.config import Config, EncodingConfig, EVERY_FRAME, KeyframeConfig, MotionConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe
from convseq_ros.core.frame_gate import FrameGate
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Pose, Reason
import numpy as np

BLANK = blank_descriptor(EncodingConfig())


def by(**settings):
    return replace(EVERY_FRAME, **settings)


def choosing(config):
    """Return a gate that does not ask whether the robot moves."""
    moving = Config(motion=MotionConfig(stationary_m=0.0, stationary_overlap=1.0))
    return FrameGate(moving, config, PaperSimilarity())


def told(keyframes, stamp_ns, descriptor, pose=None):
    return keyframes.update(stamp_ns, pose, lambda: descriptor).reason


def taken(keyframes, stamp_ns, descriptor, pose=None):
    """Return whether a frame is a keyframe: due, and another scene than the last."""
    return told(keyframes, stamp_ns, descriptor, pose) is None


def noise(seed):
    return describe(np.random.default_rng(seed).integers(0, 256, (60, 80), np.uint8))


def test_every_frame_is_a_keyframe_if_asked_for_blank_ones_too():
    keyframes = choosing(EVERY_FRAME)
    assert all(taken(keyframes, stamp, BLANK) for stamp in (0, 0, 1, 2))


def test_keyframes_come_at_the_interval_asked_for():
    keyframes = choosing(by(keyframe_interval_s=0.5))
    stamps = range(0, 2_000_000_000, 200_000_000)
    found = [stamp // 10**8 for stamp in stamps if taken(keyframes, stamp, BLANK)]
    assert found == [0, 6, 12, 18]


def test_a_clock_that_jumps_back_starts_anew():
    keyframes = choosing(by(keyframe_interval_s=5))
    assert [taken(keyframes, stamp, BLANK) for stamp in (10**10, 0)] == [True, True]


def test_a_scene_that_did_not_change_is_left_out():
    keyframes = choosing(KeyframeConfig())
    first, second = noise(0), noise(1)
    found = [told(keyframes, index, each) for index, each in enumerate([first, first, second])]
    assert found == [None, Reason.BETWEEN_KEYFRAMES, None]


def test_blank_frames_are_left_out_when_the_scene_decides():
    keyframes = choosing(KeyframeConfig())
    assert told(keyframes, 0, BLANK) is Reason.UNINFORMATIVE


def at(x, turned_rad=0.0):
    return Pose((x, 0.0, 0.0), (0.0, 0.0, math.sin(turned_rad / 2), math.cos(turned_rad / 2)))


def test_by_odometry_keyframes_come_at_the_way_asked_for_however_long_it_takes():
    keyframes = choosing(by(keyframe_distance_m=1.0))
    way = [0.0, 0.6, 0.9, 1.1, 1.1, 1.1, 1.9, 2.2, 9.0]
    found = [x for time, x in enumerate(way) if taken(keyframes, time, BLANK, at(x))]
    assert found == [0.0, 1.1, 2.2, 9.0]


def test_turning_on_the_spot_makes_keyframes():
    keyframes = choosing(by(keyframe_distance_m=1.0))
    turns = [0.0, 0.2, 0.4, 0.6, 0.8]
    assert [taken(keyframes, 0, BLANK, at(0, turn)) for turn in turns] == [
        True,
        False,
        True,
        False,
        True,
    ]


def test_a_camera_that_is_a_little_early_now_and_then_keeps_its_rhythm():
    keyframes = choosing(by(keyframe_interval_s=0.2))
    jitter_ms = np.random.default_rng(0).integers(-6, 7, 40)
    stamps = (np.arange(40) * 100 + jitter_ms) * 1_000_000
    found = [index for index, stamp in enumerate(stamps) if taken(keyframes, int(stamp), BLANK)]
    assert found == [*range(0, 40, 2)]


def test_a_frame_whose_pose_is_not_known_is_a_keyframe():
    keyframes = choosing(by(keyframe_distance_m=1.0))
    poses = [None, at(0), None, at(0), at(0)]
    assert [taken(keyframes, 0, BLANK, pose) for pose in poses] == [True, True, True, False, False]


def test_a_gate_that_was_reset_begins_with_a_keyframe_again():
    keyframes = choosing(by(keyframe_interval_s=1.0))
    assert [taken(keyframes, stamp_ns, BLANK) for stamp_ns in (0, 1)] == [True, False]
    keyframes.reset()
    assert taken(keyframes, 1, BLANK)
