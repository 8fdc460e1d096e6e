# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq replay --output FILE.mcap` writes what the node would publish."""

from drives import shots_of
import pytest

pytest.importorskip('rosbags')

from convseq_ros.cli import main
from convseq_ros.results import COLUMNS, read_results
from convseq_ros.simulation.drive import Drive
from convseq_ros.simulation.recording import write_recording
from convseq_ros.simulation.street import Street
from convseq_ros.sources.storage import open_storage


@pytest.fixture(scope='module')
def mapped(tmp_path_factory):
    """Return a drive and its map, with poses."""
    folder = tmp_path_factory.mktemp('mapped')
    shots = shots_of(Street(60.0, seed=3), Drive(num_frames=30, width_px=160, height_px=120))
    write_recording(folder / 'drive', shots)
    assert main(['build-map', str(folder / 'drive'), str(folder / 'm.db'), '--odom', '/odom']) == 0
    return folder


def test_the_recording_tells_what_the_table_does(mapped, tmp_path):
    drive = [str(mapped / 'drive'), '--map', str(mapped / 'm.db'), '--output']
    assert main(['replay', *drive, str(tmp_path / 'x.mcap')]) == 0
    assert main(['replay', *drive, str(tmp_path / 'x.csv')]) == 0
    ((storage,), warnings) = open_storage(tmp_path / 'x.mcap')
    assert not warnings and not storage.damage
    told = []
    for message in storage.messages('/vpr_node/answer'):
        answer = message.decode()
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
