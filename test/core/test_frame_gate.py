# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The frame gate: order, standstill, keyframes and dropped frames."""

from dataclasses import replace
from unittest.mock import Mock

from convseq_ros.config import Config, EncodingConfig, EVERY_FRAME, KeyframeConfig, MotionConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor
from convseq_ros.core.encoding.glance import glance
from convseq_ros.core.gate.gate import FrameDropDetector, FrameGate, Order, StampOrder, Standstill
from convseq_ros.core.types import Reason
import numpy as np
from poses import at
import pytest

STEP_NS = 100_000_000
SECOND = 10**9


def test_stamps_are_next_late_or_of_a_clock_that_jumped_back():
    order = StampOrder()
    stamps = [5 * SECOND, 5 * SECOND, 4 * SECOND, 6 * SECOND, 5 * SECOND, 5 * SECOND - 1]
    late, jumped = Order.LATE, Order.JUMPED_BACK
    expected = [Order.NEXT, Order.NEXT, late, Order.NEXT, late, jumped]
    assert [order.check(stamp_ns) for stamp_ns in stamps] == expected
    assert order.check(5 * SECOND - 2) is late
    order.reset()
    assert order.check(0) is Order.NEXT


@pytest.fixture
def verdicts(described):
    """Return what a gate says of places, one a step; None is a frame that never comes."""

    def say(places, keyframes=EVERY_FRAME, encode=None):
        gate = FrameGate(Config(), keyframes)
        encode = encode or Mock(return_value=described(0))
        came = [step for step, place in enumerate(places) if place is not None]
        return [gate.check(step * STEP_NS, at(places[step]), encode) for step in came]

    return say


def test_frames_between_keyframes_are_not_described(verdicts, described):
    encode = Mock(return_value=described(0))
    found = verdicts(range(9), KeyframeConfig(keyframe_interval_s=0.3, keyframe_overlap=1), encode)
    between = Reason.BETWEEN_KEYFRAMES
    assert [one.reason for one in found] == [None, between, between] * 3
    assert encode.call_count == 3
    assert [one.descriptor.informative for one in found] == [True, False, False] * 3


def test_dropped_keyframes_are_counted_also_soon_after_a_stop(verdicts):
    found = verdicts([*range(12), *[11] * 6, 12, None, 14, None, None, 17, 18])
    keyframes = [one.missing for one in found if one.reason is None]
    assert keyframes == [0] * 13 + [1, 2, 0]


def test_an_unreadable_frame_is_a_keyframe_only_where_time_and_pose_decide(described):
    by_time = KeyframeConfig(keyframe_interval_s=0.3, keyframe_overlap=1)
    for keyframes, first in ((KeyframeConfig(), None), (by_time, 0)):
        gate = FrameGate(Config(), keyframes)
        found = [gate.check_unreadable(step * STEP_NS, at(step)) for step in (0, 1, 3)]
        assert found == [first, None, first]  # the second is early
    # One that stands still is none, and the next keyframe knows of no dropped ones.
    gate = FrameGate(Config(), EVERY_FRAME)
    for index in range(12):
        assert gate.check(index * STEP_NS, at(index), lambda: described(0)).reason is None
    steps = (14, 11), (15, 15), (18, 18)  # before the last, two never came
    found = [gate.check_unreadable(step * STEP_NS, at(x)) for step, x in steps]
    assert found == [None, 0, 2]


BLANK = blank_descriptor(EncodingConfig())


def choosing(config=EVERY_FRAME, **settings):
    """Return a gate that does not ask whether the robot moves."""
    moving = Config(motion=MotionConfig(stationary_m=0.0, stationary_glance=0.0))
    return FrameGate(moving, replace(config, **settings))


def taken(keyframes, stamp_ns, descriptor, pose=None):
    """Return whether a frame is a keyframe: due, and another scene than the last."""
    reason = keyframes.check(stamp_ns, pose, lambda: descriptor).reason
    assert reason in (None, Reason.BETWEEN_KEYFRAMES)
    return reason is None


def test_a_scene_that_did_not_change_is_left_out(described):
    keyframes = choosing(KeyframeConfig())
    seen = described(0), described(0), described(1)
    assert [taken(keyframes, *each) for each in enumerate(seen)] == [True, False, True]


@pytest.mark.parametrize(
    ('poses', 'expected'),
    [
        ([at(x) for x in (0.0, 0.6, 0.9, 1.1, 1.1, 1.1, 1.9, 2.2, 9.0)], [0, 3, 7, 8]),
        ([at(0, yaw=turn) for turn in (0.0, 0.2, 0.4, 0.6, 0.8)], [0, 2, 4]),
        ([None, at(0), None, at(0), at(0)], [0, 1, 2]),  # where a pose is not known
    ],
)
def test_with_odometry_keyframes_are_as_far_apart_as_configured(poses, expected):
    keyframes = choosing(keyframe_distance_m=1.0)
    found = [time for time, pose in enumerate(poses) if taken(keyframes, time, BLANK, pose)]
    assert found == expected


def test_a_camera_that_is_a_little_early_now_and_then_keeps_its_rhythm():
    keyframes = choosing(keyframe_interval_s=0.2)
    jitter_ms = np.random.default_rng(0).integers(-6, 7, 40)
    stamps = (np.arange(40) * 100 + jitter_ms) * 1_000_000
    found = [index for index, stamp in enumerate(stamps) if taken(keyframes, int(stamp), BLANK)]
    assert found == [*range(0, 40, 2)]


SCENE = np.kron(np.random.default_rng(0).integers(0, 256, (40, 60)), np.ones((8, 8)))


def watching(by_image=True, **motion):
    return Standstill(MotionConfig(**motion), by_image)


def view(shift_px=0, noise=0.0, seed=0):
    cut = SCENE[20:260, 20 + shift_px : 340 + shift_px]
    cut = cut + np.random.default_rng(seed).normal(0, noise or 1e-9, cut.shape)
    return glance(np.clip(cut, 0, 255).astype(np.uint8))


def held(still, *seen):
    """Return where the robot stands still, by poses and glances."""
    found = []
    for pose, edges in seen:
        found.append(still.check(pose, edges))
        if not found[-1]:
            still.note(pose, edges)
    return found


NOISY = view(noise=2, seed=1), view(noise=2, seed=2)


@pytest.mark.parametrize(
    ('settings', 'frames', 'expected'),
    [
        ({}, [view(), *NOISY, view(shift_px=12)], [False, True, True, False]),
        ({}, [view(), None, view(noise=1)], [False, False, True]),
        ({'by_image': False}, [view()] * 3, [False] * 3),
        ({'stationary_glance': 0.0}, [view()] * 3, [False] * 3),
    ],
)
def test_the_same_view_with_noise_is_a_standstill_if_images_decide(settings, frames, expected):
    assert held(watching(**settings), *((None, one) for one in frames)) == expected


@pytest.mark.parametrize(
    ('stationary_m', 'seen', 'expected'),
    [
        (0.05, [at(0.0), at(0.04)], [False, True]),
        (0.05, [at(0.0), at(0.06)], [False, False]),
        (0.05, [at(0.0), at(0.0, yaw=0.2)], [False, True]),
        (0.05, [at(0.0), at(0.0, yaw=0.4)], [False, False]),
        # Odometry is compared with the last that moved.
        (0.05, [at(0.02 * step) for step in range(6)], [False, True, True, False, True, True]),
        (0.0, [at(0.0), at(9.0)], [False, False]),  # without a distance, images decide
    ],
)
def test_odometry_decides_where_it_is_given_and_has_a_distance(stationary_m, seen, expected):
    shown = zip(seen, map(view, (0, 18, 36, 54, 72, 90)), strict=False)
    assert held(watching(stationary_m=stationary_m), *shown) == expected
    assert held(watching(stationary_m=0.0), (seen[0], view()), (at(9.0), view())) == [False, True]


FRAME_NS = 33_333_333


def missing(stamps_ns):
    detector = FrameDropDetector()
    return [detector.observe(int(stamp_ns)) for stamp_ns in stamps_ns]


def test_a_gap_is_counted_in_frames_once_the_interval_is_known():
    shown = [index for index in range(40) if index not in (3, 20, 30, 31)]
    counts = dict(zip(shown, missing(np.array(shown) * FRAME_NS), strict=True))
    assert {index: count for index, count in counts.items() if count} == {21: 1, 32: 2}


@pytest.mark.parametrize('share', [0.1, 0.3, 0.5])
def test_the_interval_is_that_of_the_camera_though_many_frames_are_dropped(share):
    shown = np.flatnonzero(np.random.default_rng(1).random(300) >= share)
    steps = np.diff(shown)
    assert missing(shown * FRAME_NS)[30:] == (steps[29:] - 1).tolist()


def test_jitter_is_no_gap():
    stamps = (np.arange(60) + np.random.default_rng(2).uniform(-0.1, 0.1, 60)) * FRAME_NS
    assert sum(missing(stamps)) == 0


def test_only_gaps_longer_than_the_keyframe_spacing_count_as_missing_keyframes():
    shown = [index for index in range(120) if index not in (31, 32, *range(61, 80))]
    detector, found = FrameDropDetector(), {}
    for index in shown:
        detector.observe(index * FRAME_NS)
        if index % 5 == 0 and (count := detector.observe_keyframe()):
            found[index] = count
    assert found == {80: 3}
