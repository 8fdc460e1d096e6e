# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The global similarity of images."""

from convseq_ros.core.similarity.global_similarity import global_similarity, region_blocks, widened
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest


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


def test_an_image_is_like_itself_and_unlike_noise():
    found = alike(drawn(1), drawn(1), drawn(2))
    assert found[0] == pytest.approx(1.0, abs=1e-3)
    assert 0 <= found[1] < 0.1


@pytest.mark.parametrize('right', [12, -9, 3])
def test_an_image_that_moved_a_few_blocks_to_the_side_is_still_alike(right):
    found, other = alike(drawn(1), shifted(drawn(1), 0, right), drawn(2))
    left = 1 - abs(right) / 30
    assert found == pytest.approx(left, abs=0.05) and found > other + 0.4


def test_an_image_that_moved_farther_is_unlike():
    assert alike(drawn(1), shifted(drawn(1), 0, 15))[0] < 0.1
    assert alike(drawn(1), shifted(drawn(1), 6, 0))[0] < 0.1


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 31), st.integers(0, 99))
def test_images_of_any_size_are_compared(side, seed):
    found = alike(drawn(seed, side), drawn(seed, side), side=side)
    assert found == pytest.approx(1.0, abs=2e-2)


def test_a_global_similarity_depends_on_no_other_reference():
    references = [drawn(seed) for seed in range(40)]
    together = alike(drawn(99), *references)
    alone = [alike(drawn(99), one)[0] for one in references]
    assert np.array_equal(together, alone)


def test_what_shows_nothing_is_like_nothing():
    assert alike(np.zeros((900, 32), np.float32), drawn(1))[0] == 0
