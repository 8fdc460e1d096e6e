# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which places of a drive give depth to a place, how far they are, and which is nearest."""

from convseq_ros.core.pose.estimate import MapMotion
from convseq_ros.core.types import RelativePose
import numpy as np
from poses import at
import pytest

STEP_M = 1.0


@pytest.fixture
def motion(a_map):
    """Return the motions of two drives of 12 places, each straight on, a metre apart."""
    return MapMotion(a_map(12, 12, step_m=STEP_M))


def pose(x, y=0.0):
    """Return a relative pose of which only the position matters."""
    return RelativePose((0.0, 0.0, 0.0, 1.0), (x, y, 0.0), None, np.eye(6), 0)


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
def test_neighbours_are_two_places_before_and_after_where_there_are(
    motion, index, times, expected
):
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
    turned = a_map(12, step_m=STEP_M)
    turned.places._rows.view['pose'][7] = (*at(7, yaw=0.7).position, *at(7, yaw=0.7).orientation)
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
    assert motion.nearest(5, pose(ahead_m)) == expected
    assert motion.nearest(5, RelativePose((0.0, 0.0, 0.0, 1.0), None, None, np.eye(6), 0)) == 5


def test_without_poses_in_the_map_the_place_itself_is_the_nearest(a_map):
    motion = MapMotion(a_map(12))
    assert motion.nearest(5, pose(3.0)) == 5 and motion.neighbours(5) == []
