# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses at any time, from those of an odometry."""

import math
from types import SimpleNamespace

from convseq_ros.core.types import Pose
from convseq_ros.sources.pose_track import pose_from_message, PoseTrack
from hypothesis import given, strategies
import pytest

SECOND = 1_000_000_000

MS = 1_000_000


def pose(x, degrees=0.0):
    half = math.radians(degrees) / 2
    return Pose((float(x), 0.0, 0.0), (0.0, 0.0, math.sin(half), math.cos(half)))


def degrees_of(found):
    return math.degrees(2 * math.atan2(found.orientation[2], found.orientation[3]))


@given(strategies.floats(0, 1), strategies.floats(-170, 170))
def test_a_turn_goes_on_at_a_steady_rate(share, turn):
    track = PoseTrack([(0, pose(0)), (SECOND, pose(4, turn))])
    found = track.at(round(share * SECOND))
    assert found.position[0] == pytest.approx(4 * share, abs=1e-6)
    assert degrees_of(found) == pytest.approx(share * turn, abs=1e-4)


def test_a_moment_after_the_last_pose_the_motion_is_taken_to_go_on():
    track = PoseTrack([(0, pose(0)), (SECOND // 2, pose(1, 10))])
    late = track.at(SECOND // 2 + 100 * MS)
    assert late.position[0] == pytest.approx(1.2)
    assert degrees_of(late) == pytest.approx(12, abs=1e-3)
    assert track.at(SECOND // 2 + 101 * MS) is None


def test_poses_in_the_wrong_order_are_left_out_and_a_jump_of_the_clock_begins_anew():
    track = PoseTrack([(5 * SECOND, pose(1)), (5 * SECOND, pose(9)), (5 * SECOND - 1, pose(9))])
    assert track.last_stamp_ns == 5 * SECOND and track.at(5 * SECOND) == pose(1)
    track.add(SECOND, pose(2))
    assert track.last_stamp_ns == SECOND
    assert track.at(5 * SECOND) is None and track.at(SECOND) == pose(2)


def test_a_live_track_forgets_what_is_old():
    track = PoseTrack(kept=10)
    for index in range(1000):
        track.add(index * MS, pose(index))
    assert track.at(500 * MS) is None
    assert track.at(995 * MS).position[0] == 995


def message(*orientation):
    x, y, z, w = orientation
    return SimpleNamespace(
        position=SimpleNamespace(x=1, y=2, z=3), orientation=SimpleNamespace(x=x, y=y, z=z, w=w)
    )


def test_quaternions_are_made_unit_and_impossible_ones_are_no_pose():
    assert pose_from_message(message(0, 0, 3, 4)).orientation == pytest.approx((0, 0, 0.6, 0.8))
    assert pose_from_message(message(0, 0, 0.6, 0.8)).orientation == (0, 0, 0.6, 0.8)
    assert pose_from_message(message(0, 0, 0, 0)) is None
    assert pose_from_message(message(0, 0, math.nan, 1)) is None


def test_opposite_quaternions_are_the_same_turn():
    track = PoseTrack([(0, pose(0)), (SECOND, Pose((1.0, 0.0, 0.0), (0.0, 0.0, 0.0, -1.0)))])
    assert track.at(SECOND // 2).orientation == (0, 0, 0, 1)


def test_there_is_no_pose_before_after_or_in_a_long_gap():
    track = PoseTrack([(SECOND, pose(0)), (3 * SECOND, pose(2))])
    assert [track.at(stamp) for stamp in (0, 2 * SECOND, 4 * SECOND)] == [None] * 3
    assert PoseTrack([]).at(0) is None
