# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps of odometry that no robot can have made."""

from convseq_ros.core.decision.odometry_jump import OdometryJumps
from convseq_ros.core.types import ROBOT
from poses import at
import pytest


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
