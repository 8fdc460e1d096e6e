# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What cells lose before they are compared: noise, and what a map or a drive shows on average."""

from convseq_ros.core.compiled import available
from convseq_ros.core.encoding.regions import projected_regions
from convseq_ros.core.map.place import pack_cells, Place, unpack_cells
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.background import Background
from convseq_ros.core.similarity.kernels.numpy_coherent import subtracted
from convseq_ros.core.similarity.kernels.numpy_normalization import normalized
import numpy as np
import pytest


def drawn(seed=0):
    return np.random.default_rng(seed).random((32, 32, 8), np.float32) ** 3 * 1000


def test_a_cell_loses_what_all_its_bins_have_and_is_saturated():
    cells = np.array([1, 3, 1, 1, 1, 1, 1, 1], np.float32).reshape(1, 1, 8)
    mean = 2 / 8
    expected = [0, 2 / (2 + 6 * mean), 0, 0, 0, 0, 0, 0]
    assert normalized(cells).ravel() == pytest.approx(expected, abs=1e-6)


def test_neighbouring_cells_are_blended_with_weights_of_a_gaussian():
    cells = np.zeros((5, 5, 8), np.float32)
    cells[2, 2, 0] = 100
    found = normalized(cells)[:, :, 0]
    # Of x / (x + u), with u six times the mean, which blending does not change.
    typical = 6 * 100 / cells.size
    blended = found * typical / (1 - found)
    beside = np.exp(-1 / (2 * 0.4**2))
    middle, side = 1 / (1 + 2 * beside), beside / (1 + 2 * beside)
    assert blended[2, 2] == pytest.approx(100 * middle**2, rel=2e-3)
    assert blended[1, 2] == pytest.approx(100 * middle * side, rel=2e-3)
    assert blended[2, 1] == pytest.approx(100 * middle * side, rel=2e-3)
    assert blended[1, 1] == pytest.approx(100 * side**2, rel=4e-3)
    assert not blended[0].any()


def test_noise_without_direction_and_the_strength_of_light_make_no_difference():
    cells = drawn()
    noise = np.random.default_rng(1).random((32, 32, 1), np.float32) * 300
    assert normalized(cells + noise) == pytest.approx(normalized(cells), abs=1e-5)
    assert normalized(cells * 8) == pytest.approx(normalized(cells), abs=1e-6)


@pytest.mark.skipif(not available(), reason='no compiled kernels')
@pytest.mark.parametrize('side', [1, 2, 7, 32])
def test_compiled_normalisation_is_the_definition(side):
    from convseq_ros.core.similarity.kernels.regions import normalized as compiled

    for cells in (drawn()[:side, :side], np.zeros((side, side, 8), np.float32)):
        assert compiled(cells) == pytest.approx(normalized(cells), abs=1e-6)


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


def test_the_background_of_a_map_is_the_mean_of_its_references():
    background = Background(drawn_map(20, blank=(3,)), same, projected_regions)
    assert background.update_map()
    expected = np.mean([stored(index) for index in range(20) if index != 3], axis=0)
    assert background.of_map == pytest.approx(expected, abs=1e-6)


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
