# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps of odometry that no robot can have made."""

from convseq_ros.core.decision.odometry_jump import OdometryJumps, ROBOT
from convseq_ros.core.types import Pose

UNTURNED = 0.0, 0.0, 0.0, 1.0


def at(x):
    return Pose((x, 0.0, 0.0), UNTURNED)


def jumps(*steps):
    """Return which poses of (seconds, metres) are jumps."""
    observed = OdometryJumps()
    told = [observed.observe(round(second * 1e9), at(x)) for second, x in steps]
    assert observed.count == sum(told)
    return told


def test_a_step_that_a_robot_can_make_is_none():
    fastest = ROBOT.fastest_mps
    assert jumps((0, 0.0), (1, 1.0), (1, 1.0), (2, 1.0 + fastest)) == [False] * 4


def test_twelve_metres_in_a_fifth_of_a_second_are_a_jump_and_so_is_the_way_back():
    assert jumps((0, 0.0), (0.2, 12.0), (0.4, 0.2), (0.6, 0.4)) == [False, True, True, False]


def test_centimetres_taken_for_metres_are_jumps():
    assert jumps(*((second / 5, 20.0 * second) for second in range(4))) == [
        False,
        True,
        True,
        True,
    ]


def test_another_place_at_the_same_time_is_a_jump():
    assert jumps((1, 0.0), (1, 0.1)) == [False, True]


def test_frames_without_a_pose_and_a_reset_are_no_jumps():
    observed = OdometryJumps()
    assert not observed.observe(0, at(0.0))
    assert not observed.observe(100, None)
    assert observed.observe(200, at(50.0))
    observed.reset()
    assert not observed.observe(300, at(900.0))
