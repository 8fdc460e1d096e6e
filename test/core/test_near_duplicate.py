# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The near-duplicate test: what it learns, that it skips most frames and changes no keyframe."""

from functools import cache, partial
import math

from convseq_ros.config import make_config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.glance import distance, GLANCE, glance
from convseq_ros.core.gate.gate import FrameGate
from convseq_ros.core.gate.near_duplicate import NearDuplicate
from convseq_ros.core.map.scenes import Scenes
from convseq_ros.core.types import Reason
from convseq_ros.simulation.drive import Drive
from convseq_ros.simulation.street import Street
from drives import shots_of
import numpy as np
from poses import at
import pytest

RAMP = np.linspace(60, 200, 320 * 240).reshape(240, 320)


def looking(gain=1.0):
    return glance((gain * RAMP).astype(np.uint8))


def edges(apart):
    """Return a glance that lies so far from that at 0."""
    shown = np.zeros((2, 48, 64), np.float32)
    angle = 2 * math.asin(apart / 2)
    shown[0, 0, :2] = math.cos(angle), math.sin(angle)
    return shown


FAR = None


def told(*found):
    """Return what was told of a far frame at 0, then of near frames so far away, or far ones."""
    near = NearDuplicate()
    for apart in (FAR, *found):
        near.note(edges(apart or 0.0), is_near=apart is not FAR)
    return near


def sure(near, *apart):
    return [near.is_sure(edges(each)) for each in apart]


def test_a_glance_is_invariant_to_brightness_and_a_flat_image_has_none():
    assert looking().shape == (2, GLANCE.height_px, GLANCE.width_px)
    assert np.linalg.norm(looking()) == pytest.approx(1, abs=1e-5)
    assert distance(looking(), looking(0.5)) < 0.1
    assert glance(np.full((480, 640), 90, np.uint8)) is None
    assert glance(np.zeros((1, 1), np.uint8)) is None


def test_the_near_distance_is_three_quarters_of_the_largest_before_a_far_frame():
    near = told(0.2, 0.4, 0.3, FAR)
    assert sure(near, 0.0, 0.29, 0.31) == [True, True, False]
    assert not near.is_sure(None)
    near.reset()
    assert not near.is_sure(edges(0.0))


SURE = [  # what was told after the far frame at 0, and then what is sure to be near
    # Three quarters of the largest distance before a far frame; less is noise alone.
    ((), {0.0: True, 0.27: True, 0.29: False}),
    ((0.2, FAR), {0.27: True, 0.29: False}),
    # The smallest distance of three keyframes counts.
    ((0.8, FAR, 0.4, FAR, 0.8, FAR, 0.8, FAR), {0.29: True, 0.31: False}),
    ((0.4, FAR, 0.8, FAR, 0.8, FAR, 0.8, FAR), {0.59: True, 0.61: False}),
    # A far frame right after predictions shrinks the distance.
    ((0.8, FAR, FAR), {0.44: True, 0.46: False}),
    ((FAR, FAR), {0.29: False}),
    # A robot that waits is tested once only from the first frame on.
    ((0.6,), {0.55: True, 0.61: False, 0.45: False}),
    ((0.4, FAR, 0.6), {0.55: True, 0.61: False, 0.45: False}),
    ((0.6, FAR), {0.6: False}),
]


@pytest.mark.parametrize(('found', 'expected'), SURE)
def test_the_near_distance_is_learned_from_what_was_near_and_far(found, expected):
    assert sure(told(*found), *expected) == [*expected.values()]


def test_predicted_near_frames_do_not_change_the_near_distance():
    near = told(0.4, FAR)
    assert sure(near, *np.arange(0.005, 0.8, 0.01)) == [True] * 30 + [False] * 50


def test_another_far_frame_after_predictions_shrinks_the_distance_further():
    near = told(0.8, FAR, FAR)
    assert sure(near, 0.44) == [True]
    near.note(edges(0.0), is_near=False)
    assert sure(near, 0.33, 0.34) == [True, False]


@cache
def drive(light, speed_mps):
    size = {'width_px': 320, 'height_px': 240}
    shots = Drive(
        num_frames=75, light=light, speed_mps=speed_mps, frame_rate_hz=30, seed=3, **size
    )
    small = Street(length_m=80, seed=5)
    return [shot.frame.gray for shot in shots_of(small, shots)]


@cache
def described(pixels):
    return describe(np.frombuffer(pixels, np.uint8).reshape(240, 320))


def gated(frames, poses, by_glance=True):
    """Return why each frame is no keyframe, which are keyframes, and how many are encoded."""
    config, encoded = make_config({}), []
    gate, reasons = FrameGate(config, config.keyframes), []

    def encode(gray):
        encoded.append(gray)
        return described(gray.tobytes())

    for index, (gray, pose) in enumerate(zip(frames, poses, strict=True)):
        shown = (gray,) if by_glance else ()
        verdict = gate.check(index * 33_333_333, pose, partial(encode, gray), *shown)
        reasons.append(verdict.reason)
    return reasons, [at for at, reason in enumerate(reasons) if reason is None], len(encoded)


@pytest.mark.once
@pytest.mark.parametrize(
    ('light', 'speed_mps', 'odometry'),
    [('day', 4.0, False), ('night', 1.0, False), ('night', 4.0, False), ('day', 4.0, True)],
)
def test_glances_select_the_same_keyframes_as_descriptors_of_every_frame(
    light, speed_mps, odometry
):
    """A slow drive, a stop of a second with noise, and on: with and without glances."""
    moving, rng = drive(light, speed_mps), np.random.default_rng(1)
    still = [
        np.clip(moving[24] + rng.normal(0, 2, moving[24].shape), 0, 255).astype(np.uint8)
        for _ in range(30)
    ]
    frames = [*moving[:25], *still, *moving[25:]]
    steps = [*range(25), *[24] * len(still), *range(25, len(moving))]
    poses = [at(0.13 * step) if odometry else None for step in steps]
    reasons, keyframes, encoded = gated(frames, poses)
    _, expected, every = gated(frames, poses, by_glance=False)
    assert keyframes == expected and reasons[25:55].count(Reason.STATIONARY) >= 28
    assert encoded < every - (0 if odometry else 20)


@pytest.mark.once
def test_another_light_moves_no_keyframe():
    frames = [*drive('night', 1.0), *drive('day', 4.0)]
    found, expected = (gated(frames, [None] * len(frames), shown)[1] for shown in (True, False))
    assert found == expected


def with_noise(frames):
    rng = np.random.default_rng(1)
    return [np.clip(one + rng.normal(0, 12, one.shape), 0, 255).astype(np.uint8) for one in frames]


@pytest.mark.once
@pytest.mark.parametrize('light', ['day', 'night'])
def test_noise_makes_no_keyframes_of_a_robot_that_stands(light):
    noisy = with_noise(drive(light, 4.0)[24:25] * 20)
    found, expected = (gated(noisy, [None] * 20, by_glance)[1] for by_glance in (True, False))
    assert found == [0] and expected == [*range(20)]  # by descriptors, each is another scene


@pytest.mark.once
def test_noise_makes_keyframes_of_a_robot_that_creeps_but_no_scenes():
    config = make_config({})
    gate, scenes, taken = FrameGate(config, config.keyframes), Scenes(), 0
    for index, gray in enumerate(with_noise(drive('day', 1.0))):
        verdict = gate.check(index * 33_333_333, None, partial(describe, gray), gray)
        if verdict.reason is None:
            scenes.count(verdict.edges)
            taken += 1
    assert taken >= 20
    assert 4 <= scenes.passed <= 8  # 2.5 m of a street; 5 without noise


def test_a_keyframe_is_a_scene_if_its_glance_is_far_from_that_of_the_last_scene():
    scenes, passed = Scenes(), []
    for apart in (0.0, 0.69, 0.71, 0.2, None):
        scenes.count(None if apart is None else edges(apart))
        passed.append(scenes.passed)
    assert passed == [1, 1, 2, 2, 3]
