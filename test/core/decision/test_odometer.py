# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The distance and the turns that a robot has driven, by poses along x."""

import math

from convseq_ros.core.decision.odometer import Odometer
from convseq_ros.core.rigid import matrix
from poses import at
import pytest


def test_steps_sum_to_a_distance_and_reverse_steps_are_negative():
    odometer = Odometer()
    steps = [odometer.move(matrix(at(x, yaw=yaw))) for x, yaw in ((1, 0), (4, 1), (5, 1), (3, 2))]
    assert steps == [None, 3, 1, -2]
    assert (odometer.distance_m, odometer.steps) == (6, 3)
    assert odometer.turn_rad == pytest.approx(2)


def test_the_step_after_a_forgotten_pose_is_unknown_and_the_sums_stay():
    odometer = Odometer()
    for x in (0, 2):
        odometer.move(matrix(at(x)))
    odometer.forget_pose()
    assert odometer.move(matrix(at(50, yaw=math.pi))) is None
    assert (odometer.distance_m, odometer.turn_rad, odometer.steps) == (2, 0, 1)
    assert odometer.move(matrix(at(51, yaw=math.pi))) == -1


def test_a_reset_odometer_has_no_distance_turn_or_steps():
    odometer = Odometer()
    for x in (0, 2):
        odometer.move(matrix(at(x)))
    odometer.reset()
    assert odometer.move(matrix(at(9))) is None
    assert (odometer.distance_m, odometer.turn_rad, odometer.steps) == (0, 0, 0)
