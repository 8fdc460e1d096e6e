# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Satellite fixes become poses in metres, in a frame that drives of one region share."""

import json
import math

from convseq_ros.cli import main
from convseq_ros.core.map.reader import open_map
from convseq_ros.errors import SourceError
from convseq_ros.sources import open_annotated
from convseq_ros.sources.nav_sat import Fix, local_poses
import numpy as np
import pytest
from rosbags.typesys import get_typestore, Stores

KINDS = get_typestore(Stores.ROS2_JAZZY).types
SECOND = 10**9


def fix(stamp_ns, latitude, longitude, altitude=0.0, status=0):
    stamp = KINDS['builtin_interfaces/msg/Time'](*divmod(stamp_ns, SECOND))
    return KINDS['sensor_msgs/msg/NavSatFix'](
        KINDS['std_msgs/msg/Header'](stamp, 'gps'),
        KINDS['sensor_msgs/msg/NavSatStatus'](status, 1),
        latitude,
        longitude,
        altitude,
        np.zeros(9),
        0,
    )


def test_degrees_become_metres_east_north_and_up():
    # A minute of arc on the equator is 1855.32 m eastwards and 1842.90 m northwards (WGS 84).
    minute = 1 / 60
    poses, frame = local_poses(
        [Fix(0, 0.0, 0.0, 5.0), Fix(1, 0.0, minute, 5.0), Fix(2, minute, minute, 5.0)]
    )
    (_, start), (_, east), (_, north) = poses
    assert frame == 'ENU 0.0 0.0'
    assert start.position == pytest.approx((0, 0, 5))
    assert east.position == pytest.approx((1855.32, 0.0, 5 - 1855.32**2 / 2 / 6.378e6), abs=0.01)
    assert north.position[1] == pytest.approx(1842.90, abs=0.01)
    assert start.orientation == east.orientation == pytest.approx((0, 0, 0, 1), abs=1e-6)
    half = math.sqrt(0.5)
    assert north.orientation == pytest.approx((0, 0, half, half), abs=1e-4)


def test_drives_of_one_region_share_a_frame():
    one, frame = local_poses([Fix(0, 48.137, 11.575, 520.0), Fix(1, 48.1371, 11.575, 520.0)])
    other, same = local_poses([Fix(0, 48.1371, 11.575, 520.0)])
    assert frame == same == 'ENU 48.1 11.6'
    assert one[1][1].position == pytest.approx(other[0][1].position, abs=1e-9)
    assert math.dist(one[0][1].position, one[1][1].position) == pytest.approx(11.12, abs=0.01)


def test_a_robot_that_stands_heads_as_it_did():
    poses, _ = local_poses(
        [Fix(0, 0.0, 0.0, 0.0), Fix(1, 1e-4, 0.0, 0.0), Fix(2, 1e-4, 1e-6, 0.0)]
    )
    assert len({pose.orientation for _, pose in poses}) == 1


def test_a_map_of_fixes_has_poses_and_tells_their_frame(recorder, pictures, tmp_path, capsys):
    start_ns = recorder.start_ns
    rows = [
        *recorder.drive(pictures),
        *(
            ('/fix', index, fix(start_ns + index * SECOND * 11 // 10, 48.1, 11.6 + 1e-5 * index))
            for index in range(3)
        ),
        ('/fix', 9, fix(start_ns + SECOND // 2, 0.0, 0.0, status=-1)),
    ]
    path = recorder.write('mcap file', rows)
    source = open_annotated(path, odom='/fix')
    assert source.pose_frame == 'ENU 48.1 11.6'
    east = [frame.pose.position[0] for frame in source]
    assert east[0] == pytest.approx(0.0) and east[-1] == pytest.approx(0.744, abs=0.01)
    arguments = ['build-map', str(path), str(tmp_path / 'map.db'), '--odom', '/fix']
    assert main([*arguments, '--keyframe-overlap', '1']) == 0
    assert open_map(tmp_path / 'map.db').sessions[0].frame == 'ENU 48.1 11.6'
    capsys.readouterr()
    assert main(['info', str(tmp_path / 'map.db'), '--json']) == 0
    (session,) = json.loads(capsys.readouterr().out)['sessions']
    assert (session['frame'], session['with_pose']) == ('ENU 48.1 11.6', len(pictures))


def test_a_topic_without_a_fix_is_one_line(recorder, pictures):
    rows = [
        *recorder.drive(pictures),
        ('/fix', 1, fix(1, 91.0, 0.0)),
        ('/fix', 2, fix(2, math.nan, 0.0)),
    ]
    with pytest.raises(SourceError, match='no pose of /fix is whole and finite'):
        open_annotated(recorder.write('mcap file', rows), odom='/fix')
