# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What an image looks like at a coarse glance."""

from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.regions import (
    global_descriptor,
    global_descriptor_length,
    projected_regions,
)
import cv2
import numpy as np
import pytest


def texture(seed, shift_px=0):
    rng = np.random.default_rng(seed)
    wide = cv2.resize(rng.random((40, 60)).astype(np.float32), (960, 640))
    return (wide[:512, shift_px : shift_px + 512] * 255).astype(np.uint8)


def cosine(one, other, mean):
    one, other = one - mean, other - mean
    return one @ other / np.linalg.norm(one) / np.linalg.norm(other)


def test_it_is_the_cosine_transform_of_the_leading_axes():
    cells = describe(texture(0)).cells
    image = projected_regions(cells).reshape(30, 30, 32)
    found = global_descriptor(cells)
    assert found.shape == (252,) and found.dtype == np.float16
    expected = [
        np.mean(
            image[:, :, axis]
            * (np.sqrt(2) ** ((down > 0) + (across > 0)))
            * np.outer(
                np.cos(np.pi * down * (np.arange(30) + 0.5) / 30),
                np.cos(np.pi * across * (np.arange(30) + 0.5) / 30),
            )
        )
        for down in range(6)
        for across in range(6 - down)
        for axis in range(12)
    ]
    assert found == pytest.approx(expected, abs=2e-4)


def test_an_image_shifted_by_two_cells_still_looks_alike():
    here = global_descriptor(describe(texture(0)).cells).astype(float)
    shifted = global_descriptor(describe(texture(0, 32)).cells).astype(float)
    others = np.array(
        [global_descriptor(describe(texture(seed)).cells) for seed in range(1, 9)], float
    )
    mean = others.mean(axis=0)
    alike = cosine(here, shifted, mean)
    assert alike > 0.5 > max(cosine(here, other, mean) for other in others) + 0.1


@pytest.mark.parametrize(('size', 'length'), [(64, 48), (96, 180), (128, 252), (1024, 252)])
def test_small_images_have_fewer_frequencies(size, length):
    cells = np.random.default_rng(0).random((size // 16, size // 16, 8), np.float32)
    assert len(global_descriptor(cells)) == global_descriptor_length(cells.shape) == length


def test_an_image_that_shows_nothing_gives_a_finite_answer():
    assert np.isfinite(global_descriptor(np.zeros((32, 32, 8), np.float32))).all()
