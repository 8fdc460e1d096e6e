# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Displacement fields, the motion that they share, and what it says of two images."""

from convseq_ros.core.compiled import available
from convseq_ros.core.encoding.regions import unit
from convseq_ros.core.geometry import numpy_kernels
from convseq_ros.core.geometry.alignment import fitted
from convseq_ros.core.geometry.structure import Structure
from convseq_ros.core.geometry.verification import (
    motion,
    MOTION_FIT,
    overlap,
    packed_regions,
    Verification,
)
from convseq_ros.core.geometry.verification import verify as verify_all
from convseq_ros.core.rigid import turned_by
import cv2
import numpy as np
import pytest

SIDE = 30


def scene(seed, size=60):
    """Return numbers (size, size, 32) that change from cell to cell, as regions do."""
    drawn = np.random.default_rng(seed).standard_normal((size, size, 32)).astype(np.float32)
    return cv2.GaussianBlur(drawn, (0, 0), 1.0)


def view(numbers, row=15.0, column=15.0, zoom=1.0, side=SIDE):
    """Return the regions that a camera sees of a scene, from a corner on."""
    middle = (side - 1) / 2
    moved = middle - zoom * middle
    matrix = np.array([[zoom, 0, column + moved], [0, zoom, row + moved]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(numbers, matrix, (side, side), flags=flags)
    return packed_regions(unit(warped.reshape(side * side, -1)))


def verify(query, reference, shift) -> Verification:
    return verify_all(query, [reference], [shift])[0]


KERNELS = [numpy_kernels]
if available():
    from convseq_ros.core.geometry import kernels as compiled_kernels

    KERNELS.append(compiled_kernels)
each = pytest.mark.parametrize('kernel', KERNELS)


@each
@pytest.mark.parametrize('moved', [(0, 0), (2, -3), (-5, 1), (3, 3)])
def test_a_known_shift_is_the_displacement_of_every_region(kernel, moved):
    # What lies at a row in the query lies so many rows further down in the reference.
    query, reference = view(scene(1)), view(scene(1), 15 - moved[0], 15 - moved[1])
    found = kernel.displacements(query, reference, (moved[0] - 1, moved[1] + 2))
    inside = (SIDE - abs(moved[0])) * (SIDE - abs(moved[1]))
    assert len(found) > 0.9 * inside
    assert np.abs(found[:, 2:4] - moved).max() < 0.2
    assert found[:, 4].min() > 0.95


@each
def test_displacements_are_below_half_a_cell_and_none_beyond_the_search(kernel):
    query, between = view(scene(3)), view(scene(3), 15.5, 14.75)
    found = kernel.displacements(query, between, (0, 0))
    assert np.median(found[:, 2:4], axis=0) == pytest.approx([-0.5, 0.25], abs=0.1)
    # Displacements on the border of the search are dropped, too: they may lie beyond.
    reference = view(scene(3), 15, 15 + 4)
    assert len(kernel.displacements(query, reference, (0, -2))) > 500
    for start in ((0, 0), (0, 12)):
        assert len(kernel.displacements(query, reference, start)) < 150


@each
def test_regions_are_rounded_to_int8_and_invalid_values_become_zero(kernel):
    regions = unit(scene(9, SIDE).reshape(-1, 32))
    regions[5, 3], regions[6, 4], regions[7, 2] = np.nan, np.inf, 2.0
    rows = np.zeros((SIDE, 8, 32), np.int32)
    kernel.arrange(regions, rows)
    numbers = rows.transpose(0, 2, 1)[:, :SIDE].copy().view(np.int8).reshape(-1, 32)
    assert (numbers[5, 3], numbers[6, 4], numbers[7, 2]) == (0, 0, 127)
    regions[5, 3], regions[6, 4], regions[7, 2] = 0, 0, 127 / 160
    assert np.abs(numbers / 160 - regions).max() <= 0.5001 / 160
    assert not rows[:, :, SIDE:].any()


@pytest.mark.parametrize(
    ('seen', 'shift', 'common'),
    [
        ({}, (0, 0), 1.0),
        ({'column': 21.0}, (0, -6), 24 / 36),  # 6 of 30 columns left the view
        ({'row': 12.0}, (3, 0), 27 / 33),
        ({'zoom': 0.8}, (0, 0), 0.64),  # from nearer: a part of the view
        ({'zoom': 1.25}, (0, 0), 0.64),
    ],
)
def test_views_overlap_by_what_both_show(seen, shift, common):
    query, reference = view(scene(3)), view(scene(3), **seen)
    moved = motion(query, reference, shift)
    assert overlap(moved, SIDE) == pytest.approx(common, abs=0.03)
    assert np.array_equal(verify(query, reference, shift).moved, moved)


def test_views_that_have_nothing_in_common_do_not_overlap():
    assert overlap(np.array([[0.0, 0, 0], [SIDE + 1, 0, 0]]), SIDE) == 0


@each
def test_the_motion_of_a_hand_worked_field_is_found_among_false_displacements(kernel):
    # Rows move by 1 + 0.1 (row - middle), columns by -2 + 0.05 (column - middle); a third of the
    # regions moved anywhere.
    rng, middle = np.random.default_rng(4), (SIDE - 1) / 2
    places = rng.integers(0, SIDE, (300, 2))
    moved = np.array([1.0, -2.0]) + [0.1, 0.05] * (places - middle)
    moved[:100] = rng.uniform(-4, 4, (100, 2))
    found = np.column_stack((places, moved, np.ones(300))).astype(np.float32)
    motion, off = kernel.fit_motion(found, SIDE, (0, 0))
    assert off[100:].max() < 0.25  # the false ones and the stiffness bias it a little
    assert np.median(off[:100]) > MOTION_FIT.sigma_cells
    assert motion[:, 0] == pytest.approx([1, -2], abs=0.1)
    assert motion[:, 1:] / SIDE == pytest.approx(np.diag([0.1, 0.05]), abs=0.02)
    # A single region has a motion, too.
    motion, off = kernel.fit_motion(np.array([[3, 4, 1, -1, 0.5]], np.float32), SIDE, (0, 0))
    assert np.isfinite(motion).all() and off == pytest.approx([0], abs=1e-3)


@pytest.mark.parametrize('kernel', KERNELS[1:])
@pytest.mark.parametrize('side', [6, 14, 30, 45])
@pytest.mark.parametrize('start', [(0, 0), (-3, 5), (5, -5)])
def test_kernels_find_what_numpy_finds(kernel, side, start):
    query, other = view(scene(5, 100), side=side), view(scene(6, 100), side=side)
    for reference in (view(scene(5, 100), 16.3, 13.6, 1.1, side), other):
        pair = query, reference, start
        ours, theirs = kernel.displacements(*pair), numpy_kernels.displacements(*pair)
        assert ours.shape == theirs.shape and ours == pytest.approx(theirs, abs=1e-4)
        motions = (one.fit_motion(ours, side, start) for one in (kernel, numpy_kernels))
        for one, two in zip(*motions, strict=True):
            assert one == pytest.approx(two, abs=1e-6)


def test_the_same_scene_is_verified_and_another_is_not():
    query = view(scene(7))
    for row, column, zoom in ((15, 15, 1.0), (16.4, 13.7, 1.0), (15, 15, 1.08)):
        start = round(15 - row), round(15 - column)
        same = verify(query, view(scene(7), row, column, zoom), start)
        assert same.inliers > 500 and same.strength > 350
    for seed in range(20, 30):
        elsewhere = verify(query, view(scene(seed)), (0, 0))
        assert elsewhere.inliers < 150 and elsewhere.strength < 60


@pytest.mark.parametrize('value', [0.0, np.nan, np.inf])
def test_an_image_without_gradients_or_with_invalid_values_verifies_nothing(value):
    nothing = packed_regions(np.full((SIDE**2, 32), value, np.float32))
    for pair in ((nothing, nothing), (view(scene(1)), nothing), (nothing, view(scene(1)))):
        with np.errstate(invalid='ignore'):
            found = verify(*pair, (0.0, 0.0))
            assert (found.inliers, found.strength, found.upper) == (0, 0.0, 0.0)


@pytest.mark.parametrize('start_m', [(0.0, 0.0, 0.0), (1.0, 0.0, -0.5)])
def test_a_lens_is_aligned_where_it_was(start_m):
    rng = np.random.default_rng(4)
    rays = np.c_[rng.uniform(-0.6, 0.6, (400, 2)), np.ones(400)]
    inverse_m, scale = 1 / rng.uniform(3, 60, 400), np.array([25.0, 30.0])
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = turned_by((0.01, 0.05, -0.02)), (1.2, 0.1, 0.5)
    points = rays @ moved[:3, :3].T + inverse_m[:, None] * moved[:3, 3]
    observed = points[:, :2] / points[:, 2:]
    observed[::9] += 0.1  # what is found elsewhere by chance
    start = np.eye(4)
    start[:3, 3] = start_m
    structure = Structure(rays, inverse_m, np.full(400, 1e4))
    given = structure, observed, scale, np.array((1.0,) * 4 + (0.3,) * 7), start
    found, _, off, _, _ = fitted(*given)
    assert np.abs(found - moved).max() < 0.01
    assert np.median(np.abs(off)) < 0.01
    assert np.array_equal(start[:3, 3], start_m)
