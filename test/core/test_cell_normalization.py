# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells in which noise and the strength of edges count for less."""

from convseq_ros.core.compiled import available
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


@pytest.mark.parametrize('cells', [np.zeros((4, 4, 8)), np.ones((4, 4, 8))])
def test_cells_without_direction_show_nothing(cells):
    assert not normalized(cells.astype(np.float32)).any()


@pytest.mark.skipif(not available(), reason='no compiled kernels')
@pytest.mark.parametrize('side', [1, 2, 7, 32])
def test_compiled_normalisation_is_the_definition(side):
    from convseq_ros.core.similarity.kernels.regions import normalized as compiled

    for cells in (drawn()[:side, :side], np.zeros((side, side, 8), np.float32)):
        assert compiled(cells) == pytest.approx(normalized(cells), abs=1e-6)
