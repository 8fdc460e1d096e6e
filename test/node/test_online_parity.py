# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the node says is what `convseq replay` says, in a table and in a recording."""

import signal
from unittest.mock import Mock

import pytest

pytest.importorskip('rosbags')

from convseq_ros.app.result_row import COLUMNS
from convseq_ros.cli import main
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.types import Camera, Pose
from convseq_ros.io.results import read_results
from convseq_ros.node.outputs.result_recording import ResultRecording
from convseq_ros.simulation.drive import Shot
from convseq_ros.simulation.recording import write_recording
from convseq_ros.sources.storage import open_storage
from convseq_ros.sources.topics import decode
import cv2
from drives import small_drive
import numpy as np

START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
# Two rounds, with a stop in the second; the camera of the second is turned to the left.
ROUND = 26
PLACES = [*range(ROUND), *range(6), 6, 6, 6, *range(7, 20)]
TURNED_PX = 40
CAMERA, AHEAD = Camera(320, 240, 300.0, 300.0, 160.0, 120.0), (0.0, 0.0, 0.0, 1.0)
PARAMETERS = {
    'mode': 'online', 'fixed_length': 2,
    'rival_distance': 2, 'matching': 'coherent', 'search': 'exhaustive',
    'acceptance_rule': 'margin', 'stationary_m': 0.1,
}  # fmt: skip


def view(place, turned_px):
    noise = np.random.default_rng(place).integers(0, 256, (240, 400), np.uint8)
    return cv2.GaussianBlur(noise, (7, 7), 2.0)[:, 40 + turned_px : 360 + turned_px]


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """Return a recording of images, odometry and camera_info."""
    path, shots = tmp_path_factory.mktemp('parity') / 'rounds', []
    for index, place in enumerate(PLACES):
        x = float(place + ROUND * (index >= ROUND))
        gray = view(place, -TURNED_PX if index >= ROUND else 0)
        image, pose = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR), Pose((x, 0.0, 0.0), AHEAD)
        shots.append(Shot(START_NS + index * STEP_NS, image, pose, x, camera=CAMERA))
    write_recording(path, shots, odom_topic='/wheels', info_topic='/cam/info')
    return path


def rows_of(table):
    apart = {'duration_ms', 'anchor_session'}
    return [{key: row[key] for key in row.keys() - apart} for row in read_results(table)]


@pytest.mark.parametrize('spacing', [{}, {'keyframe_distance_m': 1.5, 'max_looks': 1}])
def test_the_node_answers_as_replay_and_makes_the_same_map(
    client, start, recording, tmp_path, spacing
):
    parameters, beside = PARAMETERS | spacing, '--odom /wheels --camera-info /cam/info'.split()
    options = [
        word
        for name, value in parameters.items()
        for word in ('--' + name.replace('_', '-'), str(value))
    ]
    offline, live = tmp_path / 'offline.csv', tmp_path / 'live.csv'
    files = '--map', str(tmp_path / 'offline.db'), '--output', str(offline)
    assert main(['replay', str(recording), *files, *beside, *options]) == 0
    own = {'map_path': tmp_path / 'live.db', 'result_file': live, 'queue_size': 1000}
    node = start('vpr_node', odom_wait_s=2.0, **parameters, **own)
    client.wait_for(lambda: client.node.count_subscribers('/image'), 'the node')
    names = '/wheels:=/odom', '/cam/info:=/camera_info', '/camera/image_raw:=/image'
    assert start('outputs.drive_sender', recording, 6, *names).wait(60) == 0
    client.wait_for(lambda: len(live.read_text().splitlines()) > len(PLACES), 'all rows')
    node.send_signal(signal.SIGINT)
    assert node.wait(60) == 0

    expected = rows_of(offline)
    assert rows_of(live) == expected
    maps = [open_map(tmp_path / name) for name in ('offline.db', 'live.db')]
    assert [*maps[0].links] == [*maps[1].links]
    for name in ('pose', 'stamp_ns'):
        first, second = ([getattr(place, name) for place in one.places] for one in maps)
        assert first == second
    # The drive must be worth the comparison.
    if spacing:
        reasons = [row['reason'] for row in expected]
        # At this spacing, no place is 20 scenes back before the drive ends.
        assert reasons.count('between_keyframes') > 15 and 'recent' in reasons
        assert len(maps[1]) < len(PLACES) - 15
        return
    assert len(maps[1]) == len(PLACES) - 2
    assert {'accepted', 'recent', 'stationary'} <= {row['reason'] for row in expected}
    yaws = [float(row['relative_yaw_rad']) for row in expected if row['reason'] == 'accepted']
    assert len(yaws) > 5
    # Turned left by 40 px of a focal length of 300 px.
    assert all(yaw == pytest.approx(0.133, abs=0.02) for yaw in yaws)
    assert all(place.pose for place in maps[1].places)


@pytest.fixture(scope='module')
def mapped(tmp_path_factory):
    """Return a drive and its map, with poses."""
    folder = tmp_path_factory.mktemp('mapped')
    shots = small_drive()
    write_recording(folder / 'drive', shots)
    assert main(['build-map', str(folder / 'drive'), str(folder / 'm.db'), '--odom', '/odom']) == 0
    return folder


def test_the_recorded_answers_hold_the_values_of_the_table(mapped, tmp_path):
    drive = [str(mapped / 'drive'), '--map', str(mapped / 'm.db'), '--output']
    assert main(['replay', *drive, str(tmp_path / 'x.mcap')]) == 0
    assert main(['replay', *drive, str(tmp_path / 'x.csv')]) == 0
    ((storage,), warnings) = open_storage(tmp_path / 'x.mcap')
    assert not warnings and not storage.damage
    told = []
    for message in storage.messages('/vpr_node/answer'):
        answer = decode(message)
        assert message.log_time_ns == message.header_stamp_ns
        told.append({pair.key: pair.value for pair in answer.status[0].values})
    rows = read_results(tmp_path / 'x.csv')
    same = [name for name in COLUMNS if name != 'duration_ms']
    assert [{name: one[name] for name in same} for one in told] == [
        {name: one[name] for name in same} for one in rows
    ]
    accepted = sum(row['status'] == 'accepted' for row in rows)
    counts = {name: topic.count for name, topic in storage.topics.items()}
    assert accepted and counts['/vpr_node/pose'] == counts['/vpr_node/loop_closure'] == accepted
    assert counts['/vpr_node/debug_image'] == counts['/vpr_node/markers'] == 30


def test_recorded_answers_that_find_no_room_are_named_and_leave_nothing(tmp_path, monkeypatch):
    full = Mock(side_effect=OSError(28, 'No space left on device'))
    monkeypatch.setattr('mcap.writer.Writer.finish', full)
    with pytest.raises(OSError, match=r'x\.mcap'), ResultRecording(tmp_path / 'x.mcap'):
        pass
    assert not [*tmp_path.iterdir()]
