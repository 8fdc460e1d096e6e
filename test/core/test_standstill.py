# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the robot stands still."""

import math

from convseq_ros.config import EncodingConfig, MotionConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe
from convseq_ros.core.frame_gate import Standstill
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Pose
import numpy as np
import pytest

SMALL = EncodingConfig(image_size_px=128)
SCENE = np.kron(np.random.default_rng(0).integers(0, 256, (40, 60)), np.ones((8, 8)))


def watching(by_image=True, **motion):
    return Standstill(MotionConfig(**motion), by_image, PaperSimilarity())


def view(shift_px=0, noise=0.0, seed=0):
    cut = SCENE[20:260, 20 + shift_px : 340 + shift_px]
    cut = cut + np.random.default_rng(seed).normal(0, noise or 1e-9, cut.shape)
    return describe(np.clip(cut, 0, 255).astype(np.uint8), SMALL)


def at(x, turned_rad=0.0):
    return Pose((x, 0.0, 0.0), (0.0, 0.0, math.sin(turned_rad / 2), math.cos(turned_rad / 2)))


def test_the_same_view_with_noise_is_a_standstill_and_another_view_is_not():
    still = watching()
    frames = [view(), view(noise=2, seed=1), view(noise=2, seed=2), view(shift_px=12)]
    assert [still.update(one, None) for one in frames] == [False, True, True, False]


def test_creeping_adds_up_to_motion():
    still = watching()
    held = [still.update(view(shift_px=step), None) for step in range(12)]
    assert not held[0] and True in held and held.count(False) > 1


@pytest.mark.parametrize('settings', [{'by_image': False}, {'stationary_overlap': 1.0}])
def test_images_are_asked_only_where_they_should_be(settings):
    still = watching(**settings)
    assert [still.update(view(), None) for _ in range(3)] == [False] * 3


@pytest.mark.parametrize(
    ('pose', 'holds'),
    [(at(0.04), True), (at(0.06), False), (at(0.0, 0.2), True), (at(0.0, 0.4), False)],
)
def test_odometry_decides_where_it_is_given(pose, holds):
    still = watching(stationary_m=0.05)
    assert not still.update(view(), at(0.0))
    assert still.update(view(shift_px=18), pose) is holds


def test_odometry_is_compared_with_the_last_that_moved():
    still = watching(stationary_m=0.05)
    held = [still.update(view(), at(0.02 * step)) for step in range(8)]
    assert held == [False, True, True, False, True, True, False, True]


def test_without_a_distance_odometry_is_not_asked():
    still = watching(stationary_m=0.0)
    assert not still.update(view(), at(0.0))
    assert still.update(view(), at(9.0)) and not still.update(view(shift_px=18), at(9.0))


def test_a_dark_frame_is_no_standstill_and_does_not_count():
    still = watching()
    frames = [view(), blank_descriptor(SMALL), view(noise=1)]
    assert [still.update(one, None) for one in frames] == [False, False, True]


def test_after_a_reset_the_first_frame_moves():
    still = watching()
    assert [still.update(view(), None) for _ in range(2)] == [False, True]
    still.reset()
    assert not still.update(view(), None)
