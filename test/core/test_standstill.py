# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the robot stands still."""

import math

from convseq_ros.config import EncodingConfig, MotionConfig
from convseq_ros.core.encoding.descriptor import describe, nothing_seen
from convseq_ros.core.standstill import Standstill
from convseq_ros.core.types import Pose
import numpy as np
import pytest

SMALL = EncodingConfig(image_size_px=128)
SCENE = np.kron(np.random.default_rng(0).integers(0, 256, (40, 60)), np.ones((8, 8)))


def seen(shift_px=0, noise=0.0, seed=0):
    view = SCENE[20:260, 20 + shift_px : 340 + shift_px]
    view = view + np.random.default_rng(seed).normal(0, noise or 1e-9, view.shape)
    return describe(np.clip(view, 0, 255).astype(np.uint8), SMALL)


def at(x, turned_rad=0.0):
    return Pose((x, 0.0, 0.0), (0.0, 0.0, math.sin(turned_rad / 2), math.cos(turned_rad / 2)))


def test_the_same_view_with_noise_is_a_standstill_and_another_view_is_not():
    still = Standstill(MotionConfig(), by_image=True)
    frames = [seen(), seen(noise=2, seed=1), seen(noise=2, seed=2), seen(shift_px=12)]
    assert [still.holds(one, None) for one in frames] == [False, True, True, False]


def test_creeping_adds_up_to_motion():
    still = Standstill(MotionConfig(), by_image=True)
    held = [still.holds(seen(shift_px=step), None) for step in range(12)]
    assert not held[0] and True in held and held.count(False) > 1


@pytest.mark.parametrize(
    'still',
    [
        Standstill(MotionConfig(), by_image=False),
        Standstill(MotionConfig(stationary_overlap=1.0), by_image=True),
    ],
)
def test_images_are_asked_only_where_they_should_be(still):
    assert [still.holds(seen(), None) for _ in range(3)] == [False] * 3


@pytest.mark.parametrize(
    ('pose', 'holds'),
    [(at(0.04), True), (at(0.06), False), (at(0.0, 0.2), True), (at(0.0, 0.4), False)],
)
def test_odometry_decides_where_it_is_given(pose, holds):
    still = Standstill(MotionConfig(stationary_m=0.05), by_image=True)
    assert not still.holds(seen(), at(0.0))
    assert still.holds(seen(shift_px=18), pose) is holds


def test_odometry_is_compared_with_the_last_that_moved():
    still = Standstill(MotionConfig(stationary_m=0.05), by_image=True)
    held = [still.holds(seen(), at(0.02 * step)) for step in range(8)]
    assert held == [False, True, True, False, True, True, False, True]


def test_without_a_distance_odometry_is_not_asked():
    still = Standstill(MotionConfig(stationary_m=0.0), by_image=True)
    assert not still.holds(seen(), at(0.0))
    assert still.holds(seen(), at(9.0)) and not still.holds(seen(shift_px=18), at(9.0))


def test_a_dark_frame_is_no_standstill_and_does_not_count():
    still = Standstill(MotionConfig(), by_image=True)
    frames = [seen(), nothing_seen(SMALL), seen(noise=1)]
    assert [still.holds(one, None) for one in frames] == [False, False, True]


def test_after_a_reset_the_first_frame_moves():
    still = Standstill(MotionConfig(), by_image=True)
    assert [still.holds(seen(), None) for _ in range(2)] == [False, True]
    still.reset()
    assert not still.holds(seen(), None)
