# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""In online mode too, with odometry and camera_info, the node answers as `convseq replay`."""

import signal
import subprocess
import sys

import pytest

pytest.importorskip('rosbags')

from convseq_ros.cli import main
from convseq_ros.core.map.reader import open_map
from convseq_ros.results import read_results
import cv2
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

STORE = get_typestore(Stores.ROS2_JAZZY)
START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
# Two rounds, with a stop in the second; the camera of the second is turned to the left.
PLACES = [*range(14), *range(6), 6, 6, 6, *range(7, 14)]
TURNED_PX = 40
PARAMETERS = {
    'mode': 'online', 'exclusion_s': 0.5, 'exclusion_m': 3.0, 'fixed_length': 2,
    'rival_distance': 2, 'matching': 'coherent', 'search': 'exhaustive', 'kernel': 'numpy',
    'acceptance_rule': 'margin', 'stationary_m': 0.1,
}  # fmt: skip


def view(place, turned_px):
    noise = np.random.default_rng(place).integers(0, 256, (240, 400), np.uint8)
    return cv2.GaussianBlur(noise, (7, 7), 2.0)[:, 40 + turned_px : 360 + turned_px]


def messages():
    """Yield topic, time and message: odometry at twice the rate of images, between them."""
    kinds = STORE.types

    def header(stamp_ns, frame_id):
        stamp = kinds['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
        return kinds['std_msgs/msg/Header'](stamp, frame_id)

    zero = kinds['geometry_msgs/msg/Vector3'](0.0, 0.0, 0.0)
    for index in range(2 * len(PLACES)):
        stamp_ns = START_NS + index * STEP_NS // 2
        where = np.interp(index / 2, range(len(PLACES)), np.unwrap(PLACES, period=14))
        pose = kinds['geometry_msgs/msg/Pose'](
            kinds['geometry_msgs/msg/Point'](float(where), 0.0, 0.0),
            kinds['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
        )
        yield (
            '/wheels',
            stamp_ns,
            kinds['nav_msgs/msg/Odometry'](
                header(stamp_ns, 'odom'),
                'base',
                kinds['geometry_msgs/msg/PoseWithCovariance'](pose, np.zeros(36)),
                kinds['geometry_msgs/msg/TwistWithCovariance'](
                    kinds['geometry_msgs/msg/Twist'](zero, zero), np.zeros(36)
                ),
            ),
        )
    k = np.array([300.0, 0, 160, 0, 300, 120, 0, 0, 1])
    for index, place in enumerate(PLACES):
        stamp_ns = START_NS + index * STEP_NS
        yield (
            '/cam/info',
            stamp_ns,
            kinds['sensor_msgs/msg/CameraInfo'](
                header(stamp_ns, 'camera'),
                240,
                320,
                'plumb_bob',
                np.zeros(5),
                k,
                np.eye(3).ravel(),
                np.zeros(12),
                0,
                0,
                kinds['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, False),
            ),
        )
        gray = view(place, -TURNED_PX if index >= 14 else 0)
        yield (
            '/cam/image',
            stamp_ns,
            kinds['sensor_msgs/msg/Image'](
                header(stamp_ns, 'camera'), 240, 320, 'mono8', 0, 320, gray.ravel()
            ),
        )


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp('parity') / 'rounds'
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for topic, time_ns, message in sorted(messages(), key=lambda item: item[1]):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            data = STORE.serialize_cdr(message, kind)
            writer.write(connections[topic], time_ns, data)
    return path


def rows_of(table):
    return [
        {
            name: value
            for name, value in row.items()
            if name not in ('duration_ms', 'anchor_session')
        }
        for row in read_results(table)
    ]


@pytest.mark.parametrize('spacing', [{}, {'keyframe_distance_m': 1.5}, {'max_looks': 1}])
def test_the_node_answers_as_replay_and_makes_the_same_map(
    client, start, recording, tmp_path, spacing
):
    options, parameters = [], PARAMETERS | spacing
    for name, value in parameters.items():
        options += ['--' + name.replace('_', '-'), str(value).lower()]
    offline, live = tmp_path / 'offline.csv', tmp_path / 'live.csv'
    assert (
        main(
            [
                'replay',
                str(recording),
                '--map',
                str(tmp_path / 'offline.db'),
                '--output',
                str(offline),
                '--odom',
                '/wheels',
                '--camera-info',
                '/cam/info',
                *options,
            ]
        )
        == 0
    )
    settings = parameters | {
        'map_path': tmp_path / 'live.db',
        'result_file': live,
        'queue_size': 1000,
        'odom_wait_s': 2.0,
    }
    node = start(
        'vpr_node',
        '--ros-args',
        *(part for name, value in settings.items() for part in ('-p', f'{name}:={value}')),
    )
    client.wait_for(lambda: client.node.count_subscribers('/image'), 'the node')
    subprocess.run(
        [
            sys.executable,
            '-m',
            'convseq_ros.node.player',
            recording,
            '--rate',
            '1.5',
            '--odom',
            '/wheels',
            '--camera-info',
            '/cam/info',
        ],
        check=True,
        timeout=60,
    )
    part = live.with_name('live.csv.part')
    client.wait_for(lambda: len(part.read_text().splitlines()) > len(PLACES), 'all rows')
    node.send_signal(signal.SIGINT)
    assert node.wait(60) == 0

    expected = rows_of(offline)
    assert rows_of(live) == expected
    maps = [open_map(tmp_path / name) for name in ('offline.db', 'live.db')]
    assert [*maps[0].links] == [*maps[1].links]
    assert [place.pose for place in maps[0].places] == [place.pose for place in maps[1].places]
    assert [place.stamp_ns for place in maps[0].places] == [
        place.stamp_ns for place in maps[1].places
    ]
    # The drive must be worth the comparison.
    if 'keyframe_distance_m' in spacing:
        reasons = [row['reason'] for row in expected]
        assert reasons.count('between_keyframes') > 15 and 'accepted' in reasons
        assert len(maps[1]) < len(PLACES) - 15
        return
    if spacing:
        assert len(maps[1]) < len(PLACES) - 10
        return
    assert len(maps[1]) == len(PLACES) - 2
    assert {'accepted', 'recent', 'stationary', 'ambiguous'} <= {row['reason'] for row in expected}
    yaws = [float(row['relative_yaw_rad']) for row in expected if row['reason'] == 'accepted']
    assert len(yaws) > 5
    # Turned left by 40 px of a focal length of 300 px.
    assert all(yaw == pytest.approx(0.133, abs=0.02) for yaw in yaws)
    assert all(place.pose for place in maps[1].places)
