# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Near duplicates: what is learned of them, that no keyframe changes; how far views overlap."""

from functools import cache, partial
import math
from unittest.mock import Mock

from convseq_ros.config import make_config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.glance import distance, GLANCE, glance
from convseq_ros.core.encoding.regions import projected_regions
from convseq_ros.core.gate.gate import FrameGate
from convseq_ros.core.gate.near_duplicate import NearDuplicate, Overlap
from convseq_ros.core.map.online import Scenes
from convseq_ros.core.similarity.coherent import extract
from convseq_ros.core.similarity.kernels.numpy_coherent import coherent_score, normalized
from convseq_ros.core.types import Reason
from convseq_ros.simulation.drive import Drive
from convseq_ros.simulation.street import Street
import cv2
from drives import shots_of
import numpy as np
from poses import at
import pytest

CONFIG = make_config({})
FAR = None


def edges(apart):
    """Return a glance that lies so far from that at 0."""
    shown = np.zeros((2, 48, 64), np.float32)
    angle = 2 * math.asin(apart / 2)
    shown[0, 0, :2] = math.cos(angle), math.sin(angle)
    return shown


def told(*found):
    """Return what was told of a far frame at 0, then of near frames so far away, or far ones."""
    near = NearDuplicate()
    for apart in (FAR, *found):
        near.note(edges(apart or 0.0), is_near=apart is not FAR)
    return near


def sure(near, *apart):
    return [near.is_sure(edges(each)) for each in apart]


def test_a_glance_is_invariant_to_brightness_and_a_flat_image_has_none():
    ramp = np.linspace(60, 200, 320 * 240).reshape(240, 320)
    bright, dim = (glance((gain * ramp).astype(np.uint8)) for gain in (1.0, 0.5))
    assert bright.shape == (2, GLANCE.height_px, GLANCE.width_px)
    assert np.linalg.norm(bright) == pytest.approx(1, abs=1e-5)
    assert distance(bright, dim) < 0.1
    assert glance(np.full((480, 640), 90, np.uint8)) is None
    assert glance(np.zeros((1, 1), np.uint8)) is None


def test_without_a_glance_and_after_a_reset_nothing_is_sure():
    near = told(0.4, FAR)
    assert sure(near, 0.0) == [True] and not near.is_sure(None)
    near.reset()
    assert sure(near, 0.0) == [False]


SURE = [  # what was told after the far frame at 0, and then what is sure to be near
    # Three quarters of the largest distance before a far frame; less is noise alone.
    ((), {0.0: True, 0.27: True, 0.29: False}),
    ((0.2, FAR), {0.27: True, 0.29: False}),
    ((0.2, 0.4, 0.3, FAR), {0.29: True, 0.31: False}),
    # What is sure changes nothing that comes after.
    ((0.4, FAR), {0.005 + one / 100: one < 30 for one in range(80)}),
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


def test_another_far_frame_after_predictions_shrinks_the_distance_further():
    near = told(0.8, FAR, FAR)
    assert sure(near, 0.44) == [True]
    near.note(edges(0.0), is_near=False)
    assert sure(near, 0.33, 0.34) == [True, False]


@cache
def drive(light, speed_mps):
    how = {'num_frames': 75, 'frame_rate_hz': 30, 'seed': 3, 'width_px': 320, 'height_px': 240}
    shots = shots_of(Street(length_m=80, seed=5), Drive(light=light, speed_mps=speed_mps, **how))
    return [shot.frame.gray for shot in shots]


@cache
def described(pixels):
    return describe(np.frombuffer(pixels, np.uint8).reshape(240, 320))


def gated(frames, poses, by_glance=True):
    """Return why each frame is no keyframe, which are keyframes, and how many are encoded."""
    gate, reasons, encode = FrameGate(CONFIG, CONFIG.keyframes), [], Mock(side_effect=described)
    for index, (gray, pose) in enumerate(zip(frames, poses, strict=True)):
        shown = (gray,) if by_glance else ()
        encoding = partial(encode, gray.tobytes())
        reasons.append(gate.check(index * 33_333_333, pose, encoding, *shown).reason)
    keyframes = [at for at, reason in enumerate(reasons) if reason is None]
    return reasons, keyframes, encode.call_count


def with_noise(frames, sigma=12):
    noise = np.random.default_rng(1).normal(0, sigma, (len(frames), *frames[0].shape))
    return [*np.clip(frames + noise, 0, 255).astype(np.uint8)]


@pytest.mark.once
@pytest.mark.parametrize(
    ('light', 'speed_mps', 'odometry'),
    [('day', 4.0, False), ('night', 1.0, False), ('night', 4.0, False), ('day', 4.0, True)],
)
def test_glances_select_the_keyframes_that_descriptors_would_select(light, speed_mps, odometry):
    """A slow drive, a stop of a second with noise, and on: with and without glances."""
    moving = drive(light, speed_mps)
    still = with_noise(moving[24:25] * 30, 2)
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


@pytest.mark.once
@pytest.mark.parametrize('light', ['day', 'night'])
def test_noise_makes_no_keyframes_of_a_robot_that_stands(light):
    noisy = with_noise(drive(light, 4.0)[24:25] * 20)
    found, expected = (gated(noisy, [None] * 20, by_glance)[1] for by_glance in (True, False))
    assert found == [0] and expected == [*range(20)]  # by descriptors, each is another scene


@pytest.mark.once
def test_noise_makes_keyframes_of_a_robot_that_creeps_but_no_scenes():
    gate, scenes, taken = FrameGate(CONFIG, CONFIG.keyframes), Scenes(), 0
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


SCENE = cv2.resize(np.random.default_rng(0).random((30, 60), np.float32), (640, 320)) * 200


def view(scale=1.0, noise=0.0, seed=0):
    """Return what a camera sees of a wall from nearer (scale above 1)."""
    turned = cv2.getRotationMatrix2D((320, 160), 0, scale)
    shown = cv2.warpAffine(SCENE, turned, (640, 320))[40:280, 160:480]
    shown = shown + np.random.default_rng(seed).normal(0, noise or 1e-9, shown.shape)
    return describe(np.clip(shown, 0, 255).astype(np.uint8))


def test_scene_overlap_is_the_coherent_score_of_normalised_cells():
    one, other = view(noise=2), view(1.1, noise=2, seed=1)
    features = extract(other, 4.0, projected_regions(normalized(other.cells)))
    expected, _ = coherent_score(features, projected_regions(normalized(one.cells)))
    assert Overlap(0.5)(other, one) == pytest.approx(expected, abs=0.01)


def test_the_overlap_with_a_view_falls_as_the_camera_approaches():
    overlap, first = Overlap(0.5), view()
    shares = [overlap(view(scale), first) for scale in (1.0, 1.05, 1.1, 1.2, 1.4)]
    assert shares[0] > 0.95 and shares[-1] < 0.5
    assert sorted(shares, reverse=True) == shares
