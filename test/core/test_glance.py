# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What small copies of images tell, and that they change no decision."""

from functools import cache, partial
import math

from convseq_ros.config import make_config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.frame_gate import distance, FrameGate, GLANCE, glance, NearnessByGlance
from convseq_ros.core.similarity.overlap import PaperSimilarity
from convseq_ros.core.types import Pose, Reason
from convseq_ros.simulation.drive import Drive
from convseq_ros.simulation.street import Street
from drives import shots_of
import numpy as np
import pytest

pytestmark = pytest.mark.once

RAMP = np.linspace(60, 200, 320 * 240).reshape(240, 320)


def looking(gain=1.0):
    return glance((gain * RAMP).astype(np.uint8))


def at(apart):
    """Return a glance that lies so far from that at 0."""
    seen = np.zeros((2, 48, 64), np.float32)
    angle = 2 * math.asin(apart / 2)
    seen[0, 0, :2] = math.cos(angle), math.sin(angle)
    return seen


def learned(*tested):
    """Return what has seen a far frame at 0 and then frames so far away: near, or None for far."""
    near = NearnessByGlance()
    for apart in (None, *tested):
        near.update(at(apart or 0.0), apart is not None)
    return near


def test_a_glance_is_the_same_in_a_dimmer_light_and_one_of_a_flat_image_says_nothing():
    assert looking().shape == (2, GLANCE.height_px, GLANCE.width_px)
    assert np.linalg.norm(looking()) == pytest.approx(1, abs=1e-5)
    assert distance(looking(), looking(0.5)) < 0.1
    assert glance(np.full((480, 640), 90, np.uint8)) is None
    assert glance(np.zeros((1, 1), np.uint8)) is None


def test_frames_are_surely_near_up_to_what_was_found_near_before_a_far_one():
    assert not learned().is_sure(at(0.0)) and not learned(0.2).is_sure(at(0.0))
    near = learned(0.2, 0.4, 0.3, None)
    assert near.is_sure(at(0.35)) and not near.is_sure(at(0.37)) and not near.is_sure(None)
    assert not learned(0.4, None, 0.1, None).is_sure(at(0.2))
    near.reset()
    assert not near.is_sure(at(0.0))


def test_a_robot_that_stands_far_from_the_last_far_frame_is_asked_a_few_times_only():
    near = learned(0.4, None, 0.6)
    assert near.is_sure(at(0.55)) and not near.is_sure(at(0.61)) and not near.is_sure(at(0.45))


@cache
def drive(light, speed_mps):
    size = {'width_px': 320, 'height_px': 240}
    shots = Drive(
        num_frames=50, light=light, speed_mps=speed_mps, frame_rate_hz=30, seed=3, **size
    )
    small = Street(length_m=80, seed=5)
    return [shot.frame.gray for shot in shots_of(small, shots)]


def counted(gray, count):
    count.append(1)
    return describe(gray)


@pytest.mark.parametrize(
    ('light', 'speed_mps', 'odometry'),
    [('day', 4.0, False), ('night', 1.0, False), ('day', 4.0, True)],
)
def test_keyframes_are_those_that_the_scene_of_every_frame_tells(light, speed_mps, odometry):
    """A slow drive, a stop of a second with noise, and on: with and without glances."""
    moving, rng = drive(light, speed_mps), np.random.default_rng(1)
    still = [
        np.clip(moving[24] + rng.normal(0, 2, moving[24].shape), 0, 255).astype(np.uint8)
        for _ in range(30)
    ]
    frames = [*moving[:25], *still, *moving[25:]]
    way = [*range(25), *[24] * len(still), *range(25, 50)]
    decided, described = [], []
    for by_glance in (True, False):
        config, count = make_config({}), []
        gate = FrameGate(config, config.keyframes, PaperSimilarity())
        reasons = []
        for index, gray in enumerate(frames):
            pose = Pose((0.13 * way[index], 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)) if odometry else None
            encode = partial(counted, gray, count)
            shown = (gray,) if by_glance else ()
            reasons.append(gate.update(index * 33_333_333, pose, encode, *shown).reason)
        decided.append(reasons)
        described.append(len(count))
    same = np.mean([(one is None) == (other is None) for one, other in zip(*decided, strict=True)])
    assert same >= 0.99, [*zip(*decided, strict=True)]
    assert decided[0][25:55].count(Reason.STATIONARY) >= 28
    assert described[0] < described[1] - (0 if odometry else 20)
