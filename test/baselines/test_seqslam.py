# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SeqSLAM, by hand."""

from convseq_ros.baselines.seqslam import (
    differences,
    enhanced,
    patch_normalized,
    trajectory_scores,
)
import numpy as np
import pytest

SMALL = (32, 64)


def test_every_patch_has_mean_zero_and_deviation_one():
    image = np.random.default_rng(0).integers(0, 256, SMALL, np.uint8)
    patches = patch_normalized(image).reshape(4, 8, 8, 8)
    assert np.abs(patches.mean(axis=(1, 3))).max() < 1e-5
    assert np.abs(patches.std(axis=(1, 3)) - 1).max() < 1e-5


def test_differences_are_signed_numbers_and_do_not_wrap_round():
    dark = np.zeros(SMALL, np.uint8)
    dark[:, ::2] = 10
    bright = np.zeros(SMALL, np.uint8)
    bright[:, 1::2] = 10
    one, other = patch_normalized(dark)[None], patch_normalized(bright)[None]
    assert differences(one, other)[0, 0] == pytest.approx(2.0)
    assert differences(one, other) == differences(other, one)
    assert differences(one, one)[0, 0] == 0


def test_enhancement_is_the_deviation_from_the_neighbours():
    row = np.array([[5, 5, 1, 5, 5]], np.float32)
    similarity = enhanced(row, window=4)
    assert similarity[0].argmax() == 2
    assert similarity[0, 2] == pytest.approx((row.mean() - 1) / row.std())
    assert not enhanced(np.full((2, 8), 3, np.float32)).any()


@pytest.mark.parametrize('velocity', [0.8, 1.0, 1.2])
def test_a_trajectory_is_found_at_its_velocity(velocity):
    rows = []
    for age in range(10):
        row = np.zeros(40, np.float32)
        row[30 - round(age * velocity)] = 1
        rows.append(row)
    scores = trajectory_scores(rows)
    assert scores.argmax() == 30
    assert scores[30] == 1


def test_no_trajectory_leaves_the_map():
    scores = trajectory_scores([np.zeros(12, np.float32)] * 10)
    assert np.isfinite(scores).tolist() == [False] * 7 + [True] * 5


def test_a_frame_without_similarities_counts_as_none():
    row = np.eye(1, 12, 11, dtype=np.float32)[0]
    assert trajectory_scores([row, None])[11] == 0.5
    assert not np.isfinite(trajectory_scores([np.zeros(3, np.float32)] * 10)).any()
