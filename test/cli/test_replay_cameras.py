# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq replay` of a recording with several cameras."""

from convseq_ros.cli import main
from convseq_ros.core.map.reader import open_map
from convseq_ros.results import read_results
import numpy as np
import pytest
from two_cameras import COUNT, record_two_cameras, TOPICS

pytest.importorskip('rosbags')

SETTINGS = '--keyframe-overlap', '1'
TOGETHER = 'query_index', 'duration_ms', 'localization', 'localization_quality', 'camera'


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    return record_two_cameras(tmp_path_factory.mktemp('cameras') / 'drive')


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


def test_a_map_of_both_cameras_is_that_of_one_after_the_other(recording, tmp_path):
    mounts = '0 0 0 0 0 0; 0 0 0 0 0 3.14'
    made, one = (str(tmp_path / name) for name in ('made.db', 'one.db'))
    topics = ['--topic', ' '.join(TOPICS), '--camera-to-base', mounts]
    assert main(['build-map', str(recording), made, *topics, *SETTINGS]) == 0
    for topic, mount, more in zip(TOPICS, mounts.split(';'), ([], ['--append']), strict=True):
        own = ['--topic', topic, '--camera-to-base', mount, *more]
        assert main(['build-map', str(recording), one, *own, *SETTINGS]) == 0
    made, one = open_map(made), open_map(one)
    assert [session.name for session in made.sessions] == [f'drive {one}' for one in TOPICS]
    assert made.bounds.starts.tolist() == one.bounds.starts.tolist() == [0, COUNT]
    assert [*made.places] == [*one.places]
    assert all(np.array_equal(made.packed(at), one.packed(at)) for at in range(2 * COUNT))


def test_a_camera_that_is_named_twice_is_refused(recording, tmp_path, capsys):
    path = tmp_path / 'map.db'
    assert main(['build-map', str(recording), str(path), '--topic', '/a /a']) == 1
    assert 'names a camera twice' in capsys.readouterr().err and not path.exists()


def test_as_many_cameras_are_described_as_there_are(recording, tmp_path, capsys):
    wanted = ['--map', str(tmp_path / 'map.db'), '--mode', 'online', '--camera-info', '/a']
    assert main(['replay', str(recording), *wanted, '--topic', ' '.join(TOPICS)]) == 1
    assert '1 for 2 cameras; name one of each' in capsys.readouterr().err
