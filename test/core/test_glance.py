# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What small copies of images tell, and that they change no decision."""

from functools import cache, partial

from convseq_ros.config import make_config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.frame_gate import FrameGate
from convseq_ros.core.glance import GLANCE, glance, NearnessByGlance
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Pose, Reason
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
import numpy as np
import pytest

RAMP = np.linspace(0, 200, 320 * 240).reshape(240, 320)


def seen(shift=0.0):
    return glance(np.clip(RAMP + shift * np.sin(RAMP), 0, 255).astype(np.uint8))


def test_a_glance_has_no_mean_and_one_of_a_flat_image_says_nothing():
    small = seen()
    assert small.shape == (GLANCE.height_px, GLANCE.width_px) and abs(small.mean()) < 1e-4
    assert glance(np.full((480, 640), 90, np.uint8)) is None
    assert glance(np.zeros((1, 1), np.uint8)) is None


def test_nothing_is_sure_before_some_were_far_and_one_was_near():
    near = NearnessByGlance()
    rng = np.random.default_rng(0)
    far = [rng.normal(0, 9, (24, 32)).astype(np.float32) for _ in range(GLANCE.fewest + 1)]
    for one in far:
        assert not near.is_sure(one)
        near.update(one, False)
    assert not near.is_sure(far[-1])
    near.update(far[-1] * np.float32(1.1), True)
    assert near.is_sure(far[-1]) and near.is_sure(far[-1] * np.float32(1.05))
    assert not near.is_sure(far[-1] * np.float32(1.2)) and not near.is_sure(None)
    near.reset()
    assert not near.is_sure(far[-1])


def test_where_near_and_far_mingle_nothing_is_sure_of_what_lies_apart():
    rng = np.random.default_rng(0)
    first = rng.normal(0, 9, (24, 32)).astype(np.float32)
    told = []
    for apart in (False, True):
        near = NearnessByGlance(apart)
        for scale in (1.0, 3.0, 9.0, 27.0):
            near.update(first * np.float32(scale), False)
        # Of its length further away than the last; the far ones were 2 of it.
        for further in (0.1, 1.9):
            near.update(first * np.float32(27 * (1 + further)), True)
            told.append(near.is_sure(first * np.float32(27 * 1.01)))
    assert told == [True, True, True, False]


@cache
def drive(light, speed_mps):
    shots = Drive(
        light=light,
        speed_mps=speed_mps,
        frame_rate_hz=30,
        num_frames=50,
        seed=3,
        width_px=320,
        height_px=240,
    )
    small = Street(length_m=80, seed=5)
    return [shot.frame.gray for shot in draw(small, shots)]


def counted(gray, count):
    count.append(1)
    return describe(gray)


@pytest.mark.parametrize(('light', 'odometry'), [('day', False), ('night', False), ('day', True)])
def test_keyframes_are_those_of_the_present_rule(light, odometry):
    """A slow drive, a stop of a second with noise, and on: with and without glances."""
    moving, rng = drive(light, 4.0), np.random.default_rng(1)
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
    same = np.mean([one == other for one, other in zip(*decided, strict=True)])
    assert same >= 0.99, [*zip(*decided, strict=True)]
    assert decided[0].count(Reason.STATIONARY) >= 28
    assert described[0] < described[1] - (0 if odometry else 20)
