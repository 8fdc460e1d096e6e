# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a map or a drive shows on average, and that it is subtracted."""

from convseq_ros.core.encoding.regions import projected_regions
from convseq_ros.core.map.place import pack_cells, Place, unpack_cells
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.background import Background
from convseq_ros.core.similarity.kernels.numpy_coherent import subtracted
import numpy as np
import pytest


def cells(seed):
    return np.random.default_rng(seed).random((32, 32, 8), np.float32) ** 3


def same(cells):
    return cells


def stored(seed):
    return projected_regions(unpack_cells(pack_cells(cells(seed))))


def drawn_map(count, blank=()):
    reference_map = ReferenceMap()
    for index in range(count):
        reference_map.add(Place(index), pack_cells(cells(index) * (index not in blank)))
    return reference_map


def test_the_background_is_subtracted_and_the_rest_has_unit_length():
    regions = np.array([[3.0, 4.0], [1.0, 0.0]], np.float32)
    background = np.array([[0.0, 4.0], [1.0, 1.0]], np.float32)
    assert subtracted(regions, background).tolist() == [[1.0, 0.0], [0.0, -1.0]]
    assert subtracted(regions, None) is regions


def test_regions_that_equal_the_background_say_nothing():
    regions = np.ones((4, 32), np.float32)
    assert not subtracted(regions, regions).any()


def test_the_background_of_a_map_is_the_mean_of_its_references():
    background = Background(drawn_map(20, blank=(3,)), same, projected_regions)
    assert background.update_map()
    expected = np.mean([stored(index) for index in range(20) if index != 3], axis=0)
    assert background.of_map == pytest.approx(expected, abs=1e-6)


def test_of_a_large_map_256_references_are_read():
    reference_map = drawn_map(1)
    packed = reference_map.packed(0)
    for index in range(1, 1000):
        reference_map.add(Place(index), packed)
    read = []
    reference_map.cells_of = lambda indices: read.extend(indices) or [cells(0)]
    Background(reference_map, same, projected_regions).update_map()
    assert len(read) == 256 and read[0] == 0 and read[-1] == 999
    assert 3 <= np.diff(read).min() and np.diff(read).max() <= 4


def test_a_small_map_has_no_background_and_a_growing_one_is_read_when_it_has_doubled():
    reference_map = drawn_map(19)
    background, updated = Background(reference_map, same, projected_regions), []
    assert not background.update_map() and background.of_map is None
    assert background.update(projected_regions(cells(0))) is None
    for index in range(19, 90):
        reference_map.add(Place(index), pack_cells(cells(index)))
        if background.update_map():
            updated.append(len(reference_map))
    assert updated == [20, 40, 80]


def test_a_map_of_blank_references_has_no_background():
    background = Background(drawn_map(20, blank=range(20)), same, projected_regions)
    assert background.update_map() and background.of_map is None


def test_the_drive_is_averaged_and_the_map_counts_as_5_frames():
    background = Background(drawn_map(25), same, projected_regions)
    background.update_map()
    first, second = (
        background.update(projected_regions(cells(100))),
        background.update(projected_regions(cells(101))),
    )
    one, two = projected_regions(cells(100)), projected_regions(cells(101))
    assert first == pytest.approx((one + 5 * background.of_map) / 6, abs=1e-6)
    assert second == pytest.approx((one + two + 5 * background.of_map) / 7, abs=1e-6)


def test_a_robot_that_hardly_moves_does_not_make_its_place_the_background():
    background = Background(drawn_map(25), same, projected_regions)
    background.update_map()
    once = background.update(projected_regions(cells(100)))
    for seed in range(50):
        again = cells(100) + np.float32(0.02) * cells(seed)
        assert np.array_equal(background.update(projected_regions(again)), once)
    assert not np.array_equal(background.update(projected_regions(cells(101))), once)
