# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map from a real recording, with the poses of its odometry."""

import json

from convseq_ros.cli import main
from convseq_ros.core.map.map_file import open_map
from convseq_ros.core.types import Pose
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.recording import write_recording
from convseq_ros.simulation.street import Street
from convseq_ros.sources.pose_track import PoseTrack
import pytest

DRIVE = Drive(num_frames=5, heading_deg=90.0, width_px=64, height_px=48)
SECOND_NS = 10**9


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp('drive') / 'first'
    write_recording(path, draw(Street(60.0, seed=1), DRIVE))
    return path


def test_references_carry_the_poses_of_the_odometry(recording, tmp_path, capsys):
    path = tmp_path / 'map.db'
    assert main(['build-map', str(recording), str(path), '--odom', '/odom', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['with_pose'] == 5
    places = open_map(path).places
    assert [place.stamp_ns for place in places] == [DRIVE.stamp_ns(index) for index in range(5)]
    assert [place.pose.position[0] for place in places] == pytest.approx([0, 1, 2, 3, 4])
    assert places[0].pose.orientation[2:] == pytest.approx((0.5**0.5, 0.5**0.5))
    assert main(['info', str(path), '--json']) == 0
    assert json.loads(capsys.readouterr().out)['path_m'] == pytest.approx(4)


def test_an_odometry_topic_that_is_not_there_lists_what_is(recording, tmp_path, capsys):
    path = tmp_path / 'map.db'
    assert main(['build-map', str(recording), str(path), '--odom', '/odometry']) == 1
    assert '/odom ' in capsys.readouterr().err
    assert not path.exists()


def pose(x, z=0.0, w=1.0):
    return Pose((x, 0.0, 0.0), (0.0, 0.0, z, w))


def test_poses_are_interpolated_between_their_stamps():
    track = PoseTrack([(0, pose(0)), (SECOND_NS, pose(2, z=1.0, w=0.0))])
    middle = track.at(SECOND_NS // 2)
    assert middle.position == (1.0, 0.0, 0.0)
    assert middle.orientation == pytest.approx((0, 0, 0.5**0.5, 0.5**0.5))
    assert track.at(0) == pose(0) and track.at(SECOND_NS).position[0] == 2


def test_opposite_quaternions_are_the_same_turn():
    track = PoseTrack([(0, pose(0)), (SECOND_NS, pose(1, w=-1.0))])
    assert track.at(SECOND_NS // 2).orientation == (0, 0, 0, 1)


def test_there_is_no_pose_before_after_or_in_a_long_gap():
    track = PoseTrack([(SECOND_NS, pose(0)), (3 * SECOND_NS, pose(2))])
    assert [track.at(stamp) for stamp in (0, 2 * SECOND_NS, 4 * SECOND_NS)] == [None] * 3
    assert PoseTrack([]).at(0) is None
