# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How far odometry says a robot drove, what it cannot say, and where it allows the robot to be."""

import math

from convseq_ros.config import RobotConfig
from convseq_ros.core.decision.odometry import Odometer, OdometryJumps, OdometryPrior, SLACK
from convseq_ros.core.rigid import matrix
from convseq_ros.core.types import ROBOT
import numpy as np
from poses import at
import pytest


def test_steps_sum_to_a_distance_and_reverse_steps_are_negative():
    odometer = Odometer()
    steps = [odometer.move(matrix(at(x, yaw=yaw))) for x, yaw in ((1, 0), (4, 1), (5, 1), (3, 2))]
    assert steps == [None, 3, 1, -2]
    assert (odometer.distance_m, odometer.steps) == (6, 3)
    assert odometer.turn_rad == pytest.approx(2)


@pytest.mark.parametrize(
    ('forget', 'sums'), [(Odometer.forget_pose, (2, 0, 1)), (Odometer.reset, (0, 0, 0))]
)
def test_the_step_after_a_forgotten_pose_is_unknown_and_only_a_reset_forgets_sums(forget, sums):
    odometer = Odometer()
    for x in (0, 2):
        odometer.move(matrix(at(x)))
    forget(odometer)
    assert odometer.move(matrix(at(50, yaw=math.pi))) is None
    assert (odometer.distance_m, odometer.turn_rad, odometer.steps) == sums
    assert odometer.move(matrix(at(51, yaw=math.pi))) == -1


@pytest.mark.parametrize(
    ('steps', 'expected'),  # seconds and metres, and which are jumps
    [
        ([(0, 0), (1, 1), (1, 1), (2, 1 + ROBOT.fastest_mps)], [False] * 4),
        ([(0, 0), (0.2, 12), (0.4, 0.2), (0.6, 0.4)], [False, True, True, False]),  # and back
        ([(0, 0), (0.2, 20), (0.4, 40), (0.6, 60)], [False, True, True, True]),  # centimetres
        ([(1, 0), (1, 0.1)], [False, True]),  # another place at the same time
    ],
)
def test_a_step_that_no_robot_can_make_is_a_jump(steps, expected):
    observed = OdometryJumps()
    told = [observed.observe(round(second * 1e9), at(x)) for second, x in steps]
    assert told == expected and observed.count == sum(expected)


def test_frames_without_a_pose_and_a_reset_are_no_jumps():
    observed = OdometryJumps()
    assert not observed.observe(0, at(0))
    assert not observed.observe(100, None)
    assert observed.observe(200, at(50))
    observed.reset()
    assert not observed.observe(300, at(900))


NONE = 10**9  # places from here on are of this drive: none
TENTH = RobotConfig(odometry_way_error=0.1, odometry_turn_error=0.0)


def fixed(whole, place=100, config=TENTH, grows=False, driven_m=0):
    """Return a prior that was sure of a place at x = 0, and then drove ahead."""
    prior = OdometryPrior(whole, config, grows)
    prior.move(0, at(0))
    prior.fix(place)
    prior.move(1, at(driven_m))
    return prior


def share(prior, place, start=NONE):
    return float(prior.entry_prior(np.array([place]), start)[0])


@pytest.fixture(scope='module')
def street(a_map):
    return a_map(700, step_m=1.0)


def test_a_place_500_m_away_is_implausible_and_the_true_one_is_not(street):
    prior = fixed(street, driven_m=20)
    assert share(prior, 120) == 1 and share(prior, 620) < 1e-6 and share(prior, 20) < 1e-6
    slack_m = 2 * SLACK.places  # the places on both sides are 2 m apart
    assert prior.implausible_m(120, NONE) is None
    assert prior.implausible_m(620, NONE) == pytest.approx(500 - slack_m - 0.1 * 20)


def test_the_drift_is_two_sigmas_beyond_the_tolerance_of_a_match(street):
    prior = fixed(street, driven_m=100)  # so the drift is 10 m
    slack = int(2 * SLACK.places)
    assert share(prior, 200 + slack) == 1
    assert share(prior, 200 + slack + 10) == pytest.approx(np.exp(-2))
    assert share(prior, 200 - slack - 5) == pytest.approx(np.exp(-0.5))
    assert prior.implausible_m(200 + slack + 10, NONE) is None
    assert prior.implausible_m(200 + slack + 11, NONE) == pytest.approx(1)


def test_only_turns_since_a_match_add_to_the_drift(street):
    config = RobotConfig(odometry_way_error=0.1, odometry_turn_error=0.05)
    prior = OdometryPrior(street, config, False)
    for yaw in (0, 2, 0):
        prior.move(0, at(0, yaw=yaw))
    prior.fix(100)
    prior.move(1, at(20))
    left_m = 500 - 2 * SLACK.places
    assert prior.implausible_m(620, NONE) == pytest.approx(left_m - 0.1 * 20)
    prior.move(2, at(20, yaw=1))
    assert prior.implausible_m(620, NONE) == pytest.approx(left_m - (0.1 + 0.05 * 1) * 20)


def test_a_place_of_the_running_drive_lies_at_its_odometry_pose(a_map):
    whole = a_map(200, 40, step_m=1.0)  # the second session is this drive, a metre a second
    prior = OdometryPrior(whole, TENTH, True)
    for second in range(200, 240):
        prior.move(second * 10**9, at(second - 200))
    for back in range(1, 41):
        prior.move((239 + back) * 10**9, at(39 - back))
    # At x = -1, the beginning, before any match; 79 m were driven since then.
    assert share(prior, 201, 200) == 1
    # Place 212 was passed 67 m ago, at x = 12: 3 m beyond what a match may be off.
    assert share(prior, 212, 200) == pytest.approx(np.exp(-0.5 * (2 * 3 / 6.7) ** 2))
    assert share(prior, 239, 200) < 1e-6 and prior.implausible_m(239, 200) > 20
    # Of another session nothing is known.
    assert share(prior, 150, 200) == 1


def test_sessions_are_compared_only_within_one_pose_frame(a_map):
    apart, together = a_map(300, 300, step_m=1.0), a_map(300, 300, step_m=1.0, frame='town')
    assert share(fixed(apart), 290) < 1e-6 and share(fixed(apart), 590) == 1
    assert share(fixed(together), 590) < 1e-6 and share(fixed(together), 400) == 1


def test_without_odometry_or_poses_nothing_is_denied(a_map, street):
    lost = fixed(street)
    lost.move(2, None)
    off = fixed(street, config=RobotConfig(odometry_way_error=0.0))
    bare = fixed(a_map(700))
    for prior in (lost, off, bare):
        assert share(prior, 620) == 1 and prior.implausible_m(620, NONE) is None


def test_a_match_of_one_camera_denies_far_places_to_the_other(street):
    front, rear = (OdometryPrior(street, TENTH, False) for _ in range(2))
    rear.use_matches_of(front)
    for prior in (front, rear):
        prior.move(0, at(0))
    front.fix(100)
    rear.move(1, at(10))
    assert share(rear, 110) == 1 and share(rear, 610) < 1e-6
    assert rear.is_denied(610, NONE) and not rear.is_denied(110, NONE)
    front.move(2, at(10))
    assert not front.is_denied(610, NONE)  # its own match denies nothing


@pytest.mark.parametrize('xs', [(0, 1e12, 0), (0, 0, 0, 0), (5, -5, 1e100)])
def test_entry_shares_lie_between_zero_and_one_for_any_odometry(street, xs):
    prior = OdometryPrior(street, TENTH, True)
    for second, x in enumerate(xs):
        prior.move(second, at(x))
        prior.fix(100)
        shares = prior.entry_prior(np.arange(0, 700, 7), 650)
        assert ((shares >= 0) & (shares <= 1)).all()
