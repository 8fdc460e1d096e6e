# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells, entropy and salient regions of single images."""

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.descriptor import cell_histograms, describe, salient_regions
from convseq_ros.core.encoding.entropy import image_entropy
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from test.core.entropy_map import entropy_map


def noise(seed, shape=(64, 96)):
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def test_a_vertical_edge_votes_for_the_bin_that_points_right():
    image = np.full((32, 32), 16, np.uint8)
    image[:, 8:] = 255
    cells = cell_histograms(image)
    assert cells.shape == (2, 2, 8)
    assert cells[0, 0].argmax() == 0 and cells[0, 0, 1:].max() < 1e-6
    assert cells[0, 1].max() == 0


def test_an_edge_that_turns_by_45_degrees_moves_one_bin():
    rows, columns = np.mgrid[0:64, 0:64]
    angles = [0, 45, 90, 135, 180, 225, 270, 315]
    bins = []
    for angle in angles:
        direction = np.cos(np.radians(angle)) * columns + np.sin(np.radians(angle)) * rows
        ramp = (direction - direction.min()) / np.ptp(direction) * 200 + 55
        bins.append(cell_histograms(ramp.astype(np.uint8)).sum((0, 1)).argmax())
    reached = [found for angle, found in zip(angles, bins, strict=True) if angle not in (135, 315)]
    assert reached == [0, 1, 2, 4, 5, 6]


def test_strength_is_half_the_sum_of_both_gradients_so_opposite_ones_cancel():
    rows, columns = np.mgrid[0:64, 0:64]
    along = cell_histograms((100 + columns + rows).astype(np.uint8)).sum()
    across = cell_histograms((100 + columns - rows + 32).astype(np.uint8)).sum()
    assert across < along / 10


def test_brightness_scale_changes_no_direction():
    image = noise(0, (512, 512)) // 2
    normal, bright = describe(image), describe(image * 2)
    unit = [one.cells / np.linalg.norm(one.cells) for one in (normal, bright)]
    assert np.abs(unit[0] - unit[1]).max() < 1e-6


def test_entropy_of_two_equally_frequent_values_is_near_one_bit():
    image = np.zeros((512, 512), np.uint8)
    image[:, ::2] = 255
    stripes = np.repeat(np.arange(100) % 2 * 255, 1).astype(np.uint8)
    bits = entropy_map(np.tile(stripes, (100, 1)))
    assert abs(bits[50, 50] - 1) < 0.01


def test_entropy_of_a_flat_image_is_zero_and_of_noise_is_high():
    assert image_entropy(entropy_map(np.full((100, 100), 7, np.uint8))) == 0
    assert 0.7 < image_entropy(entropy_map(noise(1, (100, 100)))) < np.log2(81) / 8


def test_a_region_is_salient_when_its_mean_entropy_reaches_the_threshold():
    bits = np.zeros((3, 3))
    bits[0, 0] = 16
    assert salient_regions(bits, 0.5).tolist() == [True, False, False, False]
    assert salient_regions(bits, 0.5001).tolist() == [False] * 4


@pytest.mark.parametrize('value', [0, 1, 128, 255])
@pytest.mark.parametrize('shape', [(1, 1), (1, 700), (480, 640)])
def test_a_flat_image_of_any_size_is_uninformative_and_has_no_nan(value, shape):
    found = describe(np.full(shape, value, np.uint8))
    assert not found.informative
    assert np.isfinite(found.cells).all() and found.entropy == 0


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 9))
def test_any_image_gives_finite_non_negative_cells_and_entropy_in_bounds(height, width, seed):
    found = describe(noise(seed, (height, width)))
    assert found.cells.shape == (32, 32, 8) and found.salient.shape == (961,)
    assert np.isfinite(found.cells).all() and found.cells.min() >= 0
    assert 0 <= found.entropy <= np.log2(81) / 8


def test_a_smaller_image_size_gives_fewer_cells():
    found = describe(noise(2), EncodingConfig(image_size_px=256))
    assert found.cells.shape == (16, 16, 8) and found.salient.shape == (225,)


@pytest.mark.parametrize(
    'image', [np.zeros((0, 5), np.uint8), np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4))]
)
def test_what_is_no_grey_image_is_refused(image):
    with pytest.raises(ValueError, match='expected'):
        describe(image)
