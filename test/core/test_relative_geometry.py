# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rays, depths and motions of drawn points, whose truth is exact."""

from dataclasses import replace
import math

from convseq_ros.core.geometry.alignment import align, Alignment, base_pose, ERROR
from convseq_ros.core.geometry.lens import is_usable, rays
from convseq_ros.core.geometry.structure import Sight, Structure, triangulate
from convseq_ros.core.rigid import inverse, matrix, of_roll_pitch_yaw, ROBOT_LENS, turned_by
from convseq_ros.core.types import Camera, Pose
import cv2
import numpy as np
import pytest

SIDE = 30
CAMERA = Camera(640, 480, 380.0, 380.0, 320.0, 240.0)
SCALE = np.array((380 / 20, 380 / 15))
MOVED = np.eye(4)
MOVED[:3, :3], MOVED[:3, 3] = turned_by((0.01, -0.05, 0.02)), (0.4, -0.1, -1.0)
GRID = np.indices((SIDE, SIDE)).reshape(2, -1).T.astype(float)


def scene(seed=0):
    """Rays of all regions, (n, 3), and their inverse depths."""
    flat = rays(CAMERA, GRID, SIDE)
    depths_m = np.random.default_rng(seed).uniform(3, 40, len(flat))
    return np.column_stack((flat, np.ones(len(flat)))), 1 / depths_m


def projected(ahead, inverse_m, moved):
    points = ahead @ moved[:3, :3].T + inverse_m[:, None] * moved[:3, 3]
    return points[:, :2] / points[:, 2:]


def alignment(covariance, share=1.0):
    return Alignment(MOVED, covariance, np.linalg.inv(covariance), 400, share, 1.0)


def off_px(found, camera):
    """Return by how many pixels known rays miss the middle of their regions, at the most."""
    known = np.isfinite(found).all(axis=1)
    points, numbers = found[known][:, None], np.array(camera.distortion)
    lens = np.array([[380.0, 0, 320], [0, 380.0, 240], [0, 0, 1]])
    if camera.distortion_model == 'equidistant':
        pixels = cv2.fisheye.distortPoints(points, lens, numbers)
    else:
        deep, still = cv2.convertPointsToHomogeneous(points), np.zeros(3)
        pixels, _ = cv2.projectPoints(deep, still, still, lens, numbers)
    return abs(pixels[:, 0] - ((GRID[known][:, ::-1] + 1.5) * (20, 15) - 0.5)).max()


@pytest.mark.parametrize(
    ('model', 'numbers'),
    [
        ('plumb_bob', (-0.3, 0.1, 0.001, -0.002, 0.01)),
        ('rational_polynomial', (0.2, -0.1, 0.001, 0.001, 0.01, 0.3, -0.05, 0.01)),
        ('equidistant', (0.05, -0.01, 0.003, -0.001)),
    ],
)
def test_rays_are_those_that_the_lens_bends_to_the_pixels(model, numbers):
    camera = replace(CAMERA, distortion_model=model, distortion=numbers)
    found = rays(camera, GRID, SIDE)
    assert is_usable(camera) and np.isfinite(found).all(axis=1).mean() > 0.9
    assert off_px(found, camera) < 0.8


def test_distortion_that_cannot_be_inverted_leaves_no_wrong_ray():
    camera = replace(CAMERA, distortion_model='plumb_bob', distortion=(-3.0, 0, 0, 0))
    found = rays(camera, GRID, SIDE)
    assert 0 < np.isfinite(found).all(axis=1).mean() < 0.7
    assert off_px(found, camera) < 0.8


UNUSABLE = [
    {'fx_px': math.nan}, {'fy_px': 0.0}, {'cx_px': math.inf}, {'width_px': 0}, {'width_px': -1},
    {'width_px': 10**400},
    {'distortion_model': 'plumb_bob', 'distortion': (math.nan, 0, 0, 0)},
    {'distortion_model': 'equidistant', 'distortion': (0.1,)},
    {'distortion_model': 'unheard of', 'distortion': (0.1, 0, 0, 0)},
]  # fmt: skip


@pytest.mark.parametrize('wrong', UNUSABLE)
def test_a_camera_of_impossible_numbers_is_not_usable(wrong):
    assert is_usable(CAMERA) and not is_usable(replace(CAMERA, **wrong))


def test_depths_follow_from_neighbours_at_a_known_distance():
    ahead, inverse_m = scene()
    sights = [Sight(projected(ahead, inverse_m, MOVED), MOVED, SCALE)]
    found = triangulate(ahead, sights)
    known = found.information > 300
    assert known.mean() > 0.5
    assert np.median(abs(found.inverse_m - inverse_m)[known]) < 1e-3


def test_a_motion_is_found_among_wrong_displacements():
    ahead, inverse_m = scene()
    there = projected(ahead, inverse_m, MOVED)
    rng = np.random.default_rng(1)
    there[rng.random(len(there)) < 0.3] += rng.normal(0, 0.2, 2)
    there[::7] = np.nan
    structure = Structure(ahead, inverse_m, np.full(len(ahead), 1e6))
    found = align(structure, Sight(there, np.eye(4), SCALE))
    assert found is not None and found.inliers > 500
    assert found.moved == pytest.approx(MOVED, abs=2e-2)
    assert align(structure, Sight(there, np.eye(4), SCALE)).moved.tolist() == found.moved.tolist()


def test_unrelated_displacements_are_aligned_with_nothing():
    ahead, inverse_m = scene()
    structure = Structure(ahead, inverse_m, np.full(len(ahead), 1e6))
    nothing = np.full((len(ahead), 2), np.nan)
    assert align(structure, Sight(nothing, np.eye(4), SCALE)) is None
    chance = np.random.default_rng(2).uniform(-0.6, 0.6, (len(ahead), 2))[:150]
    few = Structure(ahead[:150], inverse_m[:150], np.full(150, 1e6))
    assert align(few, Sight(chance, np.eye(4), SCALE)) is None


def test_the_covariance_of_a_base_is_that_of_its_lens_moved_there():
    mount = matrix(of_roll_pitch_yaw((1.0, 0.2, 0.5), 0.1, -0.2, 0.7)) @ ROBOT_LENS
    rng = np.random.default_rng(3)
    root = rng.normal(0, 1, (6, 6)) * 0.002
    known = root @ root.T
    first = base_pose(alignment(known), mount, mount)
    place = matrix(Pose(first.position_m, first.orientation))
    assert place == pytest.approx(mount @ inverse(MOVED) @ inverse(mount), abs=1e-6)
    drawn, cells = [], ERROR.cells
    # Pitch, yaw and roll of the lens, and its way right, down and ahead.
    down, across, ahead = cells.down, cells.across, cells.ahead
    root = np.diag((down, across, down, across, down, ahead)) @ root
    for numbers in rng.normal(0, 1, (4000, 6)) @ root.T:
        other = MOVED.copy()
        other[:3, :3] = turned_by(numbers[:3]) @ MOVED[:3, :3]
        other[:3, 3] += numbers[3:]
        base = mount @ inverse(other) @ inverse(mount)
        turn = cv2.Rodrigues(base[:3, :3] @ place[:3, :3].T)[0].ravel()
        drawn.append((*(base[:3, 3] - place[:3, 3]), *turn))
    floor = np.diag([cells.position_m**2] * 3 + [cells.turn_rad**2] * 3)
    expected = np.cov(np.array(drawn).T) + floor
    assert first.covariance == pytest.approx(expected, rel=0.15, abs=2e-5)
    # Where fewer regions agree, deviations are larger.
    fewer = base_pose(alignment(known, share=0.6), mount, mount)
    wider = 0.6 ** (-2 * cells.share_power)
    assert fewer.covariance - floor == pytest.approx(wider * (first.covariance - floor), rel=1e-9)


@pytest.mark.parametrize(
    ('share', 'is_told', 'explains'), [(0.6, True, True), (0.45, False, True), (0.3, False, False)]
)
def test_a_position_with_which_few_regions_agree_is_not_reported(share, is_told, explains):
    found = alignment(np.eye(6) * 1e-6, share=share)
    pose = base_pose(found, ROBOT_LENS, ROBOT_LENS)
    assert (pose.position_m is not None) is is_told
    assert pose.explains is explains


def test_a_position_with_a_large_sigma_is_not_reported():
    found = base_pose(alignment(np.eye(6)), ROBOT_LENS, ROBOT_LENS)
    assert found.position_m is None and found.position_sigma_m is None
    assert found.direction is not None and found.covariance[0, 0] >= 1e6
