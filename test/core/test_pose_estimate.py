# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of matches with their covariance, worked by hand."""

import math

from convseq_ros.core.map.place import Place
from convseq_ros.core.pose.estimate import estimate_pose, turned
from convseq_ros.core.types import Pose
from hypothesis import given, strategies
import numpy as np
import pytest

FLOORS = {'position_sigma_m': 0.5, 'heading_sigma_rad': 0.1}


def pose(x, y=0.0, degrees=0.0):
    half = math.radians(degrees) / 2
    return Pose((float(x), float(y), 0.0), (0.0, 0.0, math.sin(half), math.cos(half)))


def street(*poses):
    return [Place(stamp, pose=each) for stamp, each in enumerate(poses)]


def sigmas(estimate):
    return np.sqrt(np.diag(estimate.covariance))


EAST = street(*(pose(6 * index) for index in range(5)))


def test_along_the_way_it_is_as_uncertain_as_places_are_apart():
    # Six metres apart: half-way to the next is 3 m, a uniform error of 6 / sqrt(12).
    estimate = estimate_pose(EAST, 2, yaw_rad=0.0, **FLOORS)
    along = math.sqrt(0.5**2 + 36 / 12)
    assert sigmas(estimate) == pytest.approx([along, 0.5, 0.5, 0.1, 0.1, 0.1])
    assert estimate.pose == pose(12)
    assert np.count_nonzero(estimate.covariance) == 6


def test_the_nearer_neighbour_counts_and_a_stop_is_passed_over():
    places = street(pose(0), pose(100), pose(100), pose(100), pose(102), pose(500))
    for index in (1, 2, 3):
        assert sigmas(estimate_pose(places, index))[0] == pytest.approx(2 / math.sqrt(12))
    assert sigmas(estimate_pose(places, 5))[0] == pytest.approx(398 / math.sqrt(12))
    assert sigmas(estimate_pose(street(pose(7)), 0))[0] == 0


def test_neighbours_that_score_nearly_as_well_spread_it():
    # Places 1, 2 and 3 cannot be told apart: offsets of -6, 0 and 6 m.
    row = np.array([0.1, 0.47, 0.5, 0.46, 0.44], np.float32)
    variance = estimate_pose(EAST, 2, row=row).covariance[0, 0]
    assert variance == pytest.approx(36 / 12 + (36 + 0 + 36) / 3)
    one_sided = np.array([0.1, 0.1, 0.5, 0.46, 0.5], np.float32)
    variance = estimate_pose(EAST, 2, row=one_sided).covariance[0, 0]
    assert variance == pytest.approx(36 / 12 + (0 + 36 + 144) / 3)


def test_in_a_bend_doubt_between_places_is_doubt_about_the_heading():
    places = street(pose(0, degrees=170), pose(1, degrees=-170), pose(2, degrees=-150))
    row = np.array([0.5, 0.5, 0.1], np.float32)
    estimate = estimate_pose(places, 1, yaw_rad=0.0, row=row, **FLOORS)
    assert estimate.covariance[5, 5] == pytest.approx(0.1**2 + math.radians(20) ** 2 / 2)
    assert sigmas(estimate)[3:5] == pytest.approx([0.1, 0.1])


def test_without_a_known_turn_the_heading_is_less_certain():
    unknown = estimate_pose(EAST, 2, **FLOORS)
    assert sigmas(unknown)[5] == pytest.approx(math.hypot(0.1, 0.3))
    assert unknown.pose == EAST[2].pose


def test_a_turn_to_the_left_turns_the_pose_counter_clockwise():
    looking_east = estimate_pose(EAST, 2, yaw_rad=math.pi / 2)
    assert looking_east.pose.position == (12.0, 0.0, 0.0)
    assert looking_east.pose.orientation == pytest.approx(pose(0, degrees=90).orientation)
    # About the vertical of the map, however the camera is tilted: pitched down, then to the left.
    tilted = Pose((0.0, 0.0, 0.0), (0.0, 0.6, 0.0, 0.8))
    assert turned(tilted, math.pi).orientation == pytest.approx((-0.6, 0.0, 0.8, 0.0), abs=1e-12)


positions = strategies.tuples(*[strategies.floats(-1e3, 1e3)] * 3)


@given(strategies.lists(positions, min_size=1, max_size=6), strategies.data())
def test_it_is_never_more_certain_than_the_map(points, data):
    places = street(*(Pose(point, (0.0, 0.0, 0.0, 1.0)) for point in points))
    index = data.draw(strategies.integers(0, len(places) - 1))
    row = np.array(
        data.draw(
            strategies.lists(
                strategies.floats(0, 1, width=32), min_size=len(places), max_size=len(places)
            )
        ),
        np.float32,
    )
    covariance = estimate_pose(places, index, row=row, **FLOORS).covariance
    assert (covariance == covariance.T).all()
    assert np.linalg.eigvalsh(covariance[:3, :3]).min() >= 0.25 - 1e-6
    assert np.linalg.eigvalsh(covariance[3:, 3:]).min() >= 0.01 - 1e-9
