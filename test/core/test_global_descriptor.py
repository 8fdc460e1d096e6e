# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What an image looks like at a coarse glance, and how alike two images are as wholes."""

from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.regions import global_descriptor, projected_regions
from convseq_ros.core.similarity.global_similarity import global_similarity, region_blocks, widened
import cv2
import numpy as np
import pytest


def texture(seed, shift_px=0):
    rng = np.random.default_rng(seed)
    wide = cv2.resize(rng.random((40, 60)).astype(np.float32), (960, 640))
    return (wide[:512, shift_px : shift_px + 512] * 255).astype(np.uint8)


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


def drawn(seed, side=30):
    return np.random.default_rng(seed).normal(size=(side * side, 32)).astype(np.float32)


def shifted(regions, down, right, side=30):
    image = regions.reshape(side, side, 32)
    return np.roll(image, (down, right), (0, 1)).reshape(side * side, 32)


def alike(query, *references, side=30):
    others = np.array([region_blocks(one) for one in references], np.float64)
    return global_similarity(widened(region_blocks(query), side), others)


def test_blocks_are_the_sums_of_nine_regions():
    found = region_blocks(drawn(0)).reshape(10, 10, 32)
    sums = drawn(0).reshape(10, 3, 10, 3, 32).sum(axis=(1, 3))
    assert found / 2**17 == pytest.approx(sums, abs=1e-5)
    assert (found == np.rint(found)).all()


@pytest.mark.parametrize('right', [12, -9, 3])
def test_an_image_that_moved_a_few_blocks_to_the_side_is_still_alike(right):
    found, other = alike(drawn(1), shifted(drawn(1), 0, right), drawn(2))
    left = 1 - abs(right) / 30
    assert found == pytest.approx(left, abs=0.05) and found > other + 0.4


def test_a_global_similarity_depends_on_no_other_reference():
    references = [drawn(seed) for seed in range(40)]
    together = alike(drawn(99), *references)
    alone = [alike(drawn(99), one)[0] for one in references]
    assert np.array_equal(together, alone)


def test_what_shows_nothing_is_like_nothing():
    assert alike(np.zeros((900, 32), np.float32), drawn(1))[0] == 0
