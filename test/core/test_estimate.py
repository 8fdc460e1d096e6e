# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The estimated pose of the camera in the map and its covariance; places that give depth."""

import math

from convseq_ros.core.map.place import Place
from convseq_ros.core.pose.estimate import estimate_pose, MapMotion, turned, with_map_errors
from convseq_ros.core.types import Pose, RelativePose
from hypothesis import given, strategies
import numpy as np
from poses import at as pose
import pytest


def in_inexact_map(places, index, **given):
    """Return the estimate where poses of the map have an error of 0.5 m and 0.1 rad."""
    return with_map_errors(estimate_pose(places, index, **given), places[index].pose, 0.5, 0.1)


def along(*poses):
    return [Place(stamp, pose=each) for stamp, each in enumerate(poses)]


def sigmas(estimate):
    return np.sqrt(np.diag(estimate.covariance))


EAST = along(*(pose(6 * index) for index in range(5)))


def test_a_pose_is_as_uncertain_along_the_path_as_places_are_apart():
    # Six metres apart: half-way to the next is 3 m, a uniform error of 6 / sqrt(12).
    estimate = in_inexact_map(EAST, 2, yaw_rad=0.0)
    along = math.sqrt(0.5**2 + 36 / 12)
    assert sigmas(estimate) == pytest.approx([along, 0.5, 0.5, 0.1, 0.1, 0.1])
    assert estimate.pose == pose(12)
    assert np.count_nonzero(estimate.covariance) == 6


def test_the_nearer_neighbour_counts_and_a_stop_is_passed_over():
    places = along(pose(0), pose(100), pose(100), pose(100), pose(102), pose(500))
    for index in (1, 2, 3):
        assert sigmas(estimate_pose(places, index))[0] == pytest.approx(2 / math.sqrt(12))
    assert sigmas(estimate_pose(places, 5))[0] == pytest.approx(398 / math.sqrt(12))
    assert sigmas(estimate_pose(along(pose(7)), 0))[0] == 0


def test_neighbours_that_score_nearly_as_well_widen_the_covariance():
    # Places 1, 2 and 3 cannot be told apart: offsets of -6, 0 and 6 m.
    row = np.array([0.1, 0.47, 0.5, 0.46, 0.44], np.float32)
    variance = estimate_pose(EAST, 2, row=row).covariance[0, 0]
    assert variance == pytest.approx(36 / 12 + (36 + 0 + 36) / 3)
    one_sided = np.array([0.1, 0.1, 0.5, 0.46, 0.5], np.float32)
    variance = estimate_pose(EAST, 2, row=one_sided).covariance[0, 0]
    assert variance == pytest.approx(36 / 12 + (0 + 36 + 144) / 3)


def test_in_a_bend_ambiguous_places_raise_the_heading_uncertainty():
    turns = np.radians([160, -170, -150])
    places = along(*(pose(x, yaw=turn) for x, turn in enumerate(turns)))
    row = np.array([0.5, 0.5, 0.1], np.float32)
    estimate = in_inexact_map(places, 1, yaw_rad=0.0, row=row)
    assert estimate.covariance[5, 5] == pytest.approx(0.1**2 + math.radians(30) ** 2 / 2)
    assert sigmas(estimate)[3:5] == pytest.approx([0.1, 0.1])


def test_a_heading_error_of_the_map_grows_a_distant_poses_position_error():
    relative = RelativePose((0.0, 0.0, 0.0, 1.0), (10.0, 0.0, 0.0), None, np.eye(6) * 1e-4, 50)
    estimate = in_inexact_map(EAST, 2, relative=relative)
    # 10 m ahead of the place, 0.1 rad of its heading are 1 m across.
    across = math.hypot(0.5, 10 * 0.1, 0.01)
    assert sigmas(estimate)[:3] == pytest.approx([math.hypot(0.5, 0.01), across, across])
    assert estimate.covariance[1, 5] == pytest.approx(10 * 0.1**2)
    assert estimate.pose == pose(22)
    # Without a known turn, the heading is less certain.
    unknown = in_inexact_map(EAST, 2)
    assert sigmas(unknown)[5] == pytest.approx(math.hypot(0.1, 0.3))
    assert unknown.pose == EAST[2].pose


def test_a_turn_to_the_left_turns_the_pose_counter_clockwise():
    looking_east = estimate_pose(EAST, 2, yaw_rad=math.pi / 2)
    assert looking_east.pose.position == (12.0, 0.0, 0.0)
    east = pose(0, yaw=math.pi / 2)
    assert looking_east.pose.orientation == pytest.approx(east.orientation)
    # About the vertical of the map, however the camera is tilted: pitched down, then to the left.
    tilted = Pose((0.0, 0.0, 0.0), (0.0, 0.6, 0.0, 0.8))
    assert turned(tilted, math.pi).orientation == pytest.approx((-0.6, 0.0, 0.8, 0.0), abs=1e-12)


positions = strategies.tuples(*[strategies.floats(-1e3, 1e3)] * 3)


@given(strategies.lists(positions, min_size=1, max_size=6), strategies.data())
def test_a_pose_is_never_more_certain_than_the_map(points, data):
    places = along(*(Pose(point, (0.0, 0.0, 0.0, 1.0)) for point in points))
    index = data.draw(strategies.integers(0, len(places) - 1))
    scores = strategies.tuples(*[strategies.floats(0, 1, width=32)] * len(places))
    row = np.array(data.draw(scores), np.float32)
    covariance = in_inexact_map(places, index, row=row).covariance
    assert (covariance == covariance.T).all()
    assert np.linalg.eigvalsh(covariance[:3, :3]).min() >= 0.25 - 1e-6
    assert np.linalg.eigvalsh(covariance[3:, 3:]).min() >= 0.01 - 1e-9


def test_estimates_are_equal_if_pose_and_covariance_are():
    one, other = (estimate_pose(EAST, 2) for _ in range(2))
    assert one == other and len({one, other}) == 1
    assert one != in_inexact_map(EAST, 2) and one != estimate_pose(EAST, 3)


@pytest.fixture
def motion(a_map):
    """Return the motions of two drives of 12 places, each straight on, a metre apart."""
    return MapMotion(a_map(12, 12, step_m=1.0))


def ahead(x):
    """Return a relative pose of which only the position matters."""
    return RelativePose((0.0, 0.0, 0.0, 1.0), (x, 0.0, 0.0), None, np.eye(6), 0)


def names(neighbours):
    return [index for index, _ in neighbours]


@pytest.mark.parametrize(
    ('index', 'times', 'expected'),
    [
        (5, 1, [3, 7]),  # the first that are 1.8 m away
        (5, 2, [4, 3, 6, 7]),  # .9 m
        (0, 1, [2, 4]),  # nothing lies before the first: two on the other side
        (2, 1, [0, 4]),
        (11, 1, [9, 7]),
        (12, 1, [14, 16]),  # what lies before it is another drive
    ],
)
def test_neighbours_are_two_places_before_and_after_if_there_are(motion, index, times, expected):
    assert names(motion.neighbours(index, times)) == expected


def test_a_place_at_the_very_distance_is_a_neighbour(a_map):
    assert names(MapMotion(a_map(8, step_m=1.8)).neighbours(0)) == [1, 2]


def test_the_motion_to_a_neighbour_is_this_places_pose_in_the_neighbours_frame(motion):
    ((_, back), (_, on)) = motion.neighbours(5)
    assert back == pytest.approx(motion.moved(5, 3)) and on == pytest.approx(motion.moved(5, 7))
    assert back[:3, 3] == pytest.approx([2, 0, 0]) and on[:3, 3] == pytest.approx([-2, 0, 0])
    assert motion.moved(1, 0)[:3, 3] == pytest.approx([1, 0, 0])
    assert motion.moved(0, -1) is None and motion.moved(11, 12) is None


def test_places_that_look_elsewhere_are_no_neighbours(a_map):
    turned, aside = a_map(12, step_m=1.0), pose(7, yaw=0.7)
    turned.places._rows.view['pose'][7] = (*aside.position, *aside.orientation)
    assert names(MapMotion(turned).neighbours(5)) == [3, 8]


@pytest.mark.parametrize(
    ('ahead_m', 'expected'),
    [
        (0.6, 5),  # place 6 is .2 m nearer, which is less than .3
        (0.7, 6),
        (-2.2, 3),
        (30.0, 11),  # of this drive, and of the ten to either side
    ],
)
def test_a_place_replaces_the_match_only_if_nearer_by_30_cm(motion, ahead_m, expected):
    assert motion.nearest(5, ahead(ahead_m)) == expected
    assert motion.nearest(5, RelativePose((0.0, 0.0, 0.0, 1.0), None, None, np.eye(6), 0)) == 5


def test_without_poses_in_the_map_the_place_itself_is_the_nearest(a_map):
    motion = MapMotion(a_map(12))
    assert motion.nearest(5, ahead(3.0)) == 5 and motion.neighbours(5) == []
