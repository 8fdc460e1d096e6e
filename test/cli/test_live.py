# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live run of the demo hears odometry and camera_info of a recording, as replay does."""

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('rosbags')

from convseq_ros.cli.build_map import build
from convseq_ros.cli.processes import recognise_live
from convseq_ros.cli.replay import replay
from convseq_ros.config import make_config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.results import row
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.odometry import Drift, with_odometry
from convseq_ros.simulation.recording import write_recording
from convseq_ros.simulation.street import Street
from convseq_ros.sources import open_annotated

FRAMES = 30
# A frame is 1 m after the last one: by odometry alone, every other one stands still.
CONFIG = make_config({
    'matching': 'coherent', 'search': 'shortlist', 'kernel': 'numpy', 'fixed_length': 3,
    'stationary_m': 1.5,
})  # fmt: skip


@pytest.fixture(scope='module')
def drives(tmp_path_factory):
    """Return recordings of two drives along a street, the second one looking to the left."""
    folder = tmp_path_factory.mktemp('drives')
    street = Street(80.0, seed=3)
    for name, heading_deg in (('first', 0.0), ('second', 6.0)):
        drive = Drive(num_frames=FRAMES, heading_deg=heading_deg, width_px=320, height_px=240)
        shots = with_odometry(draw(street, drive), Drift())
        write_recording(
            folder / name,
            shots,
            odom_topic='/wheels/odom',
            truth_topic='/truth/pose',
            info_topic='/camera/info',
        )
    return folder / 'first', folder / 'second'


def written(match):
    return {name: '' if value is None else str(value) for name, value in row(match, 0.0).items()}


def test_the_live_run_answers_as_replay_with_odometry_and_camera_info(drives, tmp_path):
    first, second = drives
    path = tmp_path / 'map.db'
    build(first, path, odom='/wheels/odom')
    beside = {'odom': '/wheels/odom', 'camera_info': '/camera/info'}
    source = open_annotated(second, '', **beside)
    recognizer = PlaceRecognizer(open_map(path), CONFIG)
    offline = [written(match) for match, _ in replay(source, recognizer)]
    live = recognise_live(second, FRAMES, path, tmp_path, 1.0, CONFIG, **beside)
    for each in (*offline, *live):
        del each['duration_ms']
    assert live == offline
    # The drive must be worth the comparison.
    reasons = [each['reason'] for each in live]
    assert reasons.count('stationary') >= FRAMES // 3
    yaws = [float(each['relative_yaw_rad']) for each in live if each['reason'] == 'accepted']
    assert len(yaws) > 5
    assert all(yaw == pytest.approx(0.105, abs=0.03) for yaw in yaws)
    measured = [float(each['relative_x_m']) for each in live if each['relative_x_m']]
    assert len(measured) > 5 and max(map(abs, measured)) < 3
