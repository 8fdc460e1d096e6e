# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq replay` of a drive against its own past, and of several cameras."""

import json
import shlex

from convseq_ros.cli import main
from convseq_ros.core.map.reader import open_map
from convseq_ros.io.results import read_results, ResultWriter
from convseq_ros.sources import open_source
import numpy as np
from pictures import picture, written
import pytest
from two_cameras import COUNT, record_two_cameras, TOPICS

ROUND = 25
ONLINE = (
    '--mode', 'online', '--fixed-length', '2', '--matching', 'regional', '--search', 'exhaustive',
    '--keyframe-overlap', '1', '--rival-distance', '2',
)  # fmt: skip


@pytest.fixture
def two_rounds(tmp_path):
    return written(tmp_path / 'rounds', map(picture, [*range(ROUND), *range(ROUND)]))


@pytest.fixture
def replay(tmp_path, capsys):
    """Return a way to run the command and get its summary and its table."""

    def run(recording, path, *args):
        table = tmp_path / 'result.csv'
        words = '--map', str(path), '--output', str(table), '--json', *args
        code = main(['replay', str(recording), *words])
        printed = capsys.readouterr()
        if code:
            return code, printed.err
        return json.loads(printed.out), read_results(table)

    return run


def test_the_second_round_is_recognised_in_the_first(two_rounds, tmp_path, replay):
    path = tmp_path / 'new.db'
    summary, rows = replay(two_rounds, path, *ONLINE)
    assert summary['added'] == 2 * ROUND
    assert [row['image'] for row in rows] == [f'{at:03}.png' for at in range(2 * ROUND)]
    # A place may be matched from the 21st frame after it on, and a sequence has two.
    recent = [at for at, row in enumerate(rows) if row['reason'] == 'recent']
    assert recent == [*range(21)]
    accepted = [row for row in rows if row['reason'] == 'accepted']
    pairs = [(int(row['query_index']), int(row['reference_index'])) for row in accepted]
    assert pairs == [(index, index - ROUND) for index in range(ROUND + 1, 2 * ROUND)]
    stamps = [frame.stamp_ns for frame in open_source(two_rounds)]
    assert [place.stamp_ns for place in open_map(path).places] == stamps


def test_poses_of_accepted_frames_are_a_trajectory_for_evo(two_rounds, tmp_path, replay, capsys):
    file_interface = pytest.importorskip('evo.tools.file_interface')
    path, poses, trajectory = tmp_path / 'new.db', tmp_path / 'poses.txt', tmp_path / 'tum.txt'
    stamps = [frame.stamp_ns for frame in open_source(two_rounds)]
    rows = [f'{at / 1e9:.9f} {at_m} 0 0 0 0 0 1' for at_m, at in enumerate(stamps)]
    poses.write_text('\n'.join(rows) + '\n')
    _, table = replay(two_rounds, path, *ONLINE, '--poses', str(poses), '--tum', str(trajectory))
    read = file_interface.read_tum_trajectory_file(str(trajectory))
    accepted = [row for row in table if row['reason'] == 'accepted']
    assert len(accepted) == ROUND - 1 == read.num_poses
    assert read.positions_xyz[:, 0].tolist() == [int(row['reference_index']) for row in accepted]
    pytest.importorskip('jinja2')
    page = tmp_path / 'page.html'
    outputs = '--tum', str(trajectory), '--report', str(page)
    code, error = replay(two_rounds, tmp_path / 'none.db', *ONLINE, *outputs)
    assert code == 1 and 'no accepted place has a pose; build the map with --odom' in error
    assert page.exists()


def test_preloaded_never_writes(two_rounds, tmp_path, replay):
    path = tmp_path / 'map.db'
    replay(two_rounds, path, *ONLINE)
    before = path.read_bytes()
    summary, _ = replay(two_rounds, path, *ONLINE, '--mode', 'preloaded')
    assert path.read_bytes() == before and summary['added'] == 0
    assert sorted(tmp_path.iterdir()) == [path, tmp_path / 'result.csv', two_rounds]


def test_a_damaged_picture_costs_only_its_own_frame(two_rounds, tmp_path, replay):
    whole, rows = replay(two_rounds, tmp_path / 'whole.db', *ONLINE)
    (two_rounds / '030.png').write_bytes(b'not a picture')
    summary, after = replay(two_rounds, tmp_path / 'damaged.db', *ONLINE)
    assert after[30]['reason'] == 'unreadable' and summary['reasons']['unreadable'] == 1
    assert [one['reason'] for one in after[:30]] == [one['reason'] for one in rows[:30]]
    assert summary['added'] == whole['added'] - 1 and after[34]['reason'] == 'accepted'


def test_a_failed_run_tells_how_to_remove_its_places(two_rounds, tmp_path, replay, monkeypatch):
    path = tmp_path / 'map.db'
    for remedy in ('delete it', 'convseq map remove '):
        with monkeypatch.context() as patch:
            patch.setattr(ResultWriter, 'write', fails_at(9))
            code, told = replay(two_rounds, path, *ONLINE)
        warning, error = told.splitlines()
        assert code == 1 and 'disk full' in error
        assert f'{path}: keeps the places of this run (9); to take them out: {remedy}' in warning
        if remedy == 'delete it':
            path.unlink()
            replay(two_rounds, path, *ONLINE)
            before = open_map(path)
    words = shlex.split(warning.split('to take them out: convseq ')[1])
    assert main(words) == 0
    after = open_map(path)
    assert [*after.places] == [*before.places]
    assert [one.id for one in after.sessions] == [one.id for one in before.sessions]


def fails_at(last):
    """Return what writes rows until the disk is full."""
    left = iter(range(last - 1))

    def write(*_):
        if next(left, None) is None:
            raise OSError(28, 'disk full', 'result.csv')

    return write


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


def test_cameras_together_give_the_answers_of_each_alone(rows):
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
