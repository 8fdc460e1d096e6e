# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq replay` of a recording with several cameras."""

from convseq_ros.cli import main
from convseq_ros.results import read_results
import cv2
import numpy as np
import pytest

pytest.importorskip('rosbags')

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

TOPICS = '/front/image', '/rear/image'
COUNT, STEP_NS = 24, 100_000_000
SETTINGS = '--keyframe-overlap', '1'
TOGETHER = 'query_index', 'duration_ms', 'localization', 'localization_quality', 'camera'


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """Return one whose rear camera meets what the front one does, backwards, 20 ms later."""
    path, store = tmp_path_factory.mktemp('cameras') / 'drive', get_typestore(Stores.ROS2_JAZZY)
    kinds = store.types
    pictures = [
        cv2.GaussianBlur(
            np.random.default_rng(number).integers(0, 256, (60, 80), np.uint8), (5, 5), 1
        )
        for number in range(COUNT)
    ]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        to = [
            writer.add_connection(one, 'sensor_msgs/msg/Image', typestore=store) for one in TOPICS
        ]
        for number in range(COUNT):
            for rear, connection in enumerate(to):
                shown = pictures[COUNT - 1 - number if rear else number]
                stamp_ns = (number + 1) * STEP_NS + 20_000_000 * rear
                stamp = kinds['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
                header = kinds['std_msgs/msg/Header'](stamp, 'camera')
                message = kinds['sensor_msgs/msg/Image'](
                    header, 60, 80, 'mono8', 0, 80, shown.ravel()
                )
                data = store.serialize_cdr(message, message.__msgtype__)
                writer.write(connection, stamp_ns, data)
    return path


@pytest.fixture(scope='module')
def rows(recording, tmp_path_factory):
    """Return a function: what is said of frames of some topics, in a map of the front camera."""
    folder = tmp_path_factory.mktemp('replayed')
    own = ['--topic', TOPICS[0], *SETTINGS]
    assert main(['build-map', str(recording), str(folder / 'map.db'), *own]) == 0

    def replayed(topics):
        table = folder / 'table.csv'
        wanted = ['--map', str(folder / 'map.db'), '--topic', topics, '--output', str(table)]
        assert main(['replay', str(recording), *wanted, '--both-directions', 'true']) == 0
        return read_results(table)

    return replayed


def test_cameras_together_say_what_each_says_alone(rows):
    together = rows(' '.join(TOPICS))
    assert [row['camera'] for row in together] == [*TOPICS] * COUNT
    assert [int(row['query_index']) for row in together] == list(range(2 * COUNT))
    for topic in TOPICS:
        alone = rows(topic)
        own = [row for row in together if row.get('camera') == topic]
        for row in (*alone, *own):
            for name in TOGETHER:
                del row[name]
        assert own == alone
        assert sum(row['status'] == 'accepted' for row in own) > COUNT // 2


def test_as_many_cameras_are_described_as_there_are(recording, tmp_path, capsys):
    wanted = ['--map', str(tmp_path / 'map.db'), '--mode', 'online', '--camera-info', '/a']
    assert main(['replay', str(recording), *wanted, '--topic', ' '.join(TOPICS)]) == 1
    assert '1 for 2 cameras; name one of each' in capsys.readouterr().err
