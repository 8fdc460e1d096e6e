# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What odometry allows, on hand-worked ways along x."""

from convseq_ros.core.decision.plausibility import Plausibility
from convseq_ros.core.types import Pose
from convseq_ros.robot_config import RobotConfig
import numpy as np
import pytest

HERE = np.eye(4)


def at(x, y=0.0):
    return Pose((float(x), float(y), 0.0), (0.0, 0.0, 0.0, 1.0))


def driven(rule, xs):
    """Drive to some places of the map as far along, and match them; return what is in excess."""
    found = []
    for x, place in xs:
        rule.move(int(x * 1e9) + 1, at(x))
        found.append(rule.excess_m(at(place), HERE, 1.0, None))
    return found


def test_what_drift_allows_is_believed_and_what_it_does_not_is_off_by_so_much():
    rule = Plausibility(RobotConfig(odometry_way_error=0.1))
    # 10 m further, 11.5 m in the map: off by 1.5 m, allowed 1 m and a tenth of both ways.
    assert driven(rule, [(0, 100), (10, 111.5), (20, 121.5)]) == [None, None, None]
    assert driven(rule, [(30, 200)])[0] == pytest.approx(68.5 - 1 - 0.1 * (10 + 78.5))


def test_what_one_camera_is_sure_of_holds_for_another_one_that_comes_later():
    front, rear = Plausibility(RobotConfig()), Plausibility(RobotConfig())
    rear.share(front)
    assert driven(front, [(0, 100), (50, 150)]) == [None, None]
    found = driven(rear, [(60, 160), (61, 300), (62, 301), (63, 302)])
    assert found[0] is None and min(found[1:3]) > 50 and found[3] is None
    # Which keyframes agree is of one camera; what they found holds for both.
    assert driven(front, [(64, 303)]) == [None] and driven(front, [(65, 165)])[0] > 50


def test_a_match_that_was_not_measured_is_no_measure_for_one_that_was():
    rule = Plausibility(RobotConfig(odometry_way_error=0.1))
    excesses = []
    # The second may be off by 5 m, and is by 2 m.
    for x, place, slack_m in ((0, 100, 0.5), (5, 107, 5.0), (6, 106, 0.5)):
        rule.move(x, at(x))
        excesses.append(rule.excess_m(at(place), HERE, slack_m, None))
    assert excesses == [None, None, None]
    # Where nothing better is known, its error counts with the other's.
    rule = Plausibility(RobotConfig(odometry_way_error=0.1))
    for x, place, slack_m in ((0, 102, 5.0), (1, 101, 0.5)):
        rule.move(x, at(x))
        assert rule.excess_m(at(place), HERE, slack_m, None) is None


def test_three_keyframes_running_that_agree_count_more_than_odometry():
    rule = Plausibility(RobotConfig())
    found = driven(rule, [(0, 100), (1, 200), (2, 201), (3, 202), (4, 203)])
    assert found[0] is None and min(found[1:3]) > 50 and found[3:] == [None, None]


def test_refused_places_that_disagree_or_have_gaps_stay_refused():
    rule = Plausibility(RobotConfig())
    assert None not in driven(rule, [(0, 100), (1, 200), (2, 300), (3, 400), (4, 500)])[1:]
    rule = Plausibility(RobotConfig())
    driven(rule, [(0, 100)])
    for x in range(1, 13):
        rule.move(x, at(x))
        if x % 2:
            assert rule.excess_m(at(200 + x), HERE, 1.0, None) > 50


def test_a_place_of_this_session_is_where_odometry_was_then():
    rule = Plausibility(RobotConfig())
    for second in range(21):
        rule.move(second, at(second if second < 11 else 20 - second))
    assert rule.excess_m(at(1.0), HERE, 0.5, 1) is None
    assert rule.excess_m(at(10.0), HERE, 0.5, 10) > 5


def test_without_odometry_nothing_is_implausible():
    rule = Plausibility(RobotConfig())
    rule.move(0, at(0))
    assert rule.excess_m(at(100), HERE, 1.0, None) is None
    rule.move(1, None)
    assert rule.excess_m(at(900), HERE, 1.0, None) is None
    off = Plausibility(RobotConfig(odometry_way_error=0.0))
    assert driven(off, [(0, 100), (1, 200)]) == [None, None]


def test_odometry_that_jumps_costs_three_keyframes():
    rule = Plausibility(RobotConfig())
    found = driven(rule, [(0, 100), (1, 101), (502, 102), (503, 103), (504, 104), (505, 105)])
    assert [one is None for one in found] == [True, True, False, False, True, True]
