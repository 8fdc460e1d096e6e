# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a drive usually shows, and that it counts for nothing."""

from convseq_ros.core.map.reference_map import pack_cells, Place, ReferenceMap, unpack_cells
from convseq_ros.core.similarity.background import Layout, unusual
from convseq_ros.core.similarity.cell_normalization import evened
from convseq_ros.core.similarity.coherent import projected_regions
from convseq_ros.core.similarity.coherent_pair import shown
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


def test_the_usual_is_subtracted_and_the_rest_has_unit_length():
    regions = np.array([[3.0, 4.0], [1.0, 0.0]], np.float32)
    usual = np.array([[0.0, 4.0], [1.0, 1.0]], np.float32)
    assert unusual(regions, usual).tolist() == [[1.0, 0.0], [0.0, -1.0]]
    assert unusual(regions, None) is regions


def test_what_is_exactly_usual_says_nothing():
    regions = np.ones((4, 32), np.float32)
    assert not unusual(regions, regions).any()


def test_the_map_usually_shows_the_mean_of_its_references():
    layout = Layout(drawn_map(20, blank=(3,)), same, shown)
    assert layout.renew()
    expected = np.mean([stored(index) for index in range(20) if index != 3], axis=0)
    assert layout.of_map == pytest.approx(expected, abs=1e-6)


def test_references_are_evened_before_they_are_averaged():
    layout = Layout(drawn_map(20), evened, shown)
    layout.renew()
    read = [unpack_cells(pack_cells(cells(index))) for index in range(20)]
    expected = np.mean([projected_regions(evened(one)) for one in read], axis=0)
    assert layout.of_map == pytest.approx(expected, abs=1e-6)


def test_of_a_large_map_256_references_are_read():
    reference_map = drawn_map(1)
    packed = reference_map.packed(0)
    for index in range(1, 1000):
        reference_map.add(Place(index), packed)
    read = []
    reference_map.cells_of = lambda indices: read.extend(indices) or [cells(0)]
    Layout(reference_map, same, shown).renew()
    assert len(read) == 256 and read[0] == 0 and read[-1] == 999
    assert 3 <= np.diff(read).min() and np.diff(read).max() <= 4


def test_a_small_map_has_no_layout_and_a_growing_one_is_read_when_it_has_doubled():
    reference_map = drawn_map(19)
    layout, renewed = Layout(reference_map, same, shown), []
    assert not layout.renew() and layout.of_map is None
    assert layout.of_drive(cells(0)) is None
    for index in range(19, 90):
        reference_map.add(Place(index), pack_cells(cells(index)))
        if layout.renew():
            renewed.append(len(reference_map))
    assert renewed == [20, 40, 80]


def test_a_map_of_blank_references_has_no_layout():
    layout = Layout(drawn_map(20, blank=range(20)), same, shown)
    assert layout.renew() and layout.of_map is None


def test_the_drive_is_averaged_and_the_map_counts_as_5_frames():
    layout = Layout(drawn_map(25), same, shown)
    layout.renew()
    first, second = layout.of_drive(cells(100)), layout.of_drive(cells(101))
    one, two = projected_regions(cells(100)), projected_regions(cells(101))
    assert first == pytest.approx((one + 5 * layout.of_map) / 6, abs=1e-6)
    assert second == pytest.approx((one + two + 5 * layout.of_map) / 7, abs=1e-6)


def test_frames_before_the_layout_of_the_map_is_known_count_too():
    reference_map = drawn_map(19)
    layout = Layout(reference_map, same, shown)
    assert layout.of_drive(cells(100)) is None
    reference_map.add(Place(19), pack_cells(cells(19)))
    layout.renew()
    both = projected_regions(cells(100)) + projected_regions(cells(101))
    expected = (both + 5 * layout.of_map) / 7
    assert layout.of_drive(cells(101)) == pytest.approx(expected, abs=1e-6)


def test_a_robot_that_hardly_moves_does_not_make_its_place_the_usual_one():
    layout = Layout(drawn_map(25), same, shown)
    layout.renew()
    once = layout.of_drive(cells(100))
    for seed in range(50):
        again = cells(100) + np.float32(0.02) * cells(seed)
        assert np.array_equal(layout.of_drive(again), once)
    assert not np.array_equal(layout.of_drive(cells(101)), once)
