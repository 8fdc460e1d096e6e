# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq map merge`, `split`, `remove`, `rename`: exact, and whole or not at all."""

from contextlib import closing
from dataclasses import replace
import json
import resource
import signal

from convseq_ros import Config, Frame, open_map, PlaceRecognizer
from convseq_ros.app.map_builder import MapBuilder
from convseq_ros.cli import main
from convseq_ros.config import EncodingConfig
from convseq_ros.core.map.appender import Appender
from convseq_ros.core.map.edit import rename_session
from convseq_ros.core.map.session_slice import slices_of
from convseq_ros.core.types import Camera, Pose
from convseq_ros.errors import MapError
import numpy as np
from pictures import scene
import pytest

DRIVES, PLACES = 5, 14
CONFIG = Config(encoding=EncodingConfig(image_size_px=256))
AHEAD = (0.0, 0.0, 0.0, 1.0)


def frames(drive, count=PLACES):
    """Return a drive; three drives in turn share a way, stamps overlap, each has its poses."""
    for index in range(count):
        pose = Pose((float(index), float(drive), 0.0), AHEAD) if drive % 2 else None
        place = 100 * (drive % 3) + index
        camera = Camera(128, 96, 90.0 + drive, 90.0, 64.0, 48.0)
        gray = scene(place, drive, (128, 96))
        yield Frame(10**12 + index * 10**9, gray, f'{drive}', pose, camera=camera)


@pytest.fixture(scope='module')
def maps(tmp_path_factory):
    """Return a folder with a map of each drive, and one of all of them."""
    folder = tmp_path_factory.mktemp('maps')
    for drive in range(DRIVES):
        for path, append in ((f'drive{drive}.db', False), ('whole.db', drive > 0)):
            with MapBuilder(folder / path, CONFIG, append, f'drive {drive}') as builder:
                for frame in frames(drive):
                    builder.process(frame)
    return folder


@pytest.fixture
def run(capsys):
    """Return a way to run a command, which gives its exit code and what it said."""

    def command(*arguments):
        code = main([str(one) for one in arguments])
        said = capsys.readouterr()
        return code, said.out + said.err

    return command


@pytest.fixture
def two(maps, tmp_path, run):
    path = tmp_path / 'two.db'
    assert run('map', 'merge', maps / 'drive0.db', maps / 'drive1.db', '-o', path)[0] == 0
    return path


def held(path):
    """Return all that a map holds of its places, and of its sessions but their ids."""
    opened = open_map(path)
    pictures = opened.pictures(range(len(opened)), with_images=True)
    return (
        opened.places[:],
        [(one.packed.tobytes(), one.thumbnail, one.image) for one in pictures],
        opened.global_descriptors.tobytes(),
        [replace(session, id='') for session in opened.sessions],
    )


def answers(path):
    """Return what the recogniser says of two drives: all of every match."""
    found = []
    for drive in (20, 21):
        recognizer = PlaceRecognizer(open_map(path), CONFIG)
        found += [recognizer.process(frame) for frame in frames(drive)]
    return found


def test_a_merged_map_answers_every_frame_as_one_built_in_one_go(maps, tmp_path, run):
    parts = [maps / f'drive{drive}.db' for drive in range(DRIVES)]
    before = [path.read_bytes() for path in parts]
    code, said = run('map', 'merge', *parts, '-o', tmp_path / 'merged.db')
    assert code == 0 and f'{DRIVES * PLACES} keyframes' in said
    assert [path.read_bytes() for path in parts] == before
    assert held(tmp_path / 'merged.db') == held(maps / 'whole.db')
    ours, theirs = answers(tmp_path / 'merged.db'), answers(maps / 'whole.db')
    assert sum(one.accepted is not None for one in ours) >= PLACES
    for one, other in zip(ours, theirs, strict=True):
        assert np.array_equal(one.relative_pose is None, other.relative_pose is None)
        # A merge links by stored cells, which are rounded: 3 of 90 links differ, and the belief.
        assert one.confidence == pytest.approx(other.confidence, abs=1e-4)
        assert one.candidates[:1] == other.candidates[:1]
        rounded = 'confidence', 'localization', 'candidates', 'relative_pose', 'pose', 'anchor'
        assert one == replace(other, **{name: getattr(one, name) for name in rounded})


def test_a_merged_map_is_split_again(two, maps, tmp_path, run):
    code, said = run('map', 'split', two, '-o', tmp_path / 'parts')
    assert code == 0 and 'drive_1.db: 14 keyframes' in said
    for drive in (0, 1):
        assert held(tmp_path / 'parts' / f'drive_{drive}.db') == held(maps / f'drive{drive}.db')
    code, said = run('map', 'split', two, '-o', tmp_path / 'parts')
    assert code == 0 and 'drive_1-1.db' in said  # nothing is replaced
    assert run('map', 'split', two, '-o', tmp_path / 'parts')[0] == 1


def test_a_session_is_removed(two, maps, run):
    code, said = run('map', 'remove', two, '--session', 'drive 0', '--json')
    (told,) = json.loads(said)
    assert code == 0 and [one['name'] for one in told['sessions']] == ['drive 1']
    assert held(two) == held(maps / 'drive1.db')
    code, said = run('map', 'remove', two, '--session', '0')
    assert code == 1 and 'nothing would be left' in said and held(two)


def test_a_session_is_renamed_and_reported(two, run):
    before = held(two)
    assert run('map', 'rename', two, '--session', '1', 'night, rain')[0] == 0
    assert held(two)[:3] == before[:3]
    code, said = run('info', two, '--json')
    first, second = json.loads(said)['sessions']
    assert code == 0 and (first['name'], second['name']) == ('drive 0', 'night, rain')
    assert (second['references'], second['with_pose'], second['path_m']) == (14, 14, 13.0)
    assert '1 night, rain: 14 references, 14 with a pose, 13.0 m' in run('info', two)[1]


def test_a_word_that_is_a_name_of_one_session_and_the_number_of_another_is_refused(two, run):
    assert run('map', 'rename', two, '--session', '1', '0')[0] == 0
    code, said = run('map', 'remove', two, '--session', '0')
    assert code == 1 and "no single session is '0'; it has 0 'drive 0', 1 '0'" in said
    last = open_map(two).sessions[1].id
    assert run('map', 'remove', two, '--session', last)[0] == 0
    assert [one.name for one in open_map(two).sessions] == ['drive 0']


def test_a_limit_of_looks_that_keeps_all_is_a_limit(two, run):
    before = two.read_bytes()
    assert run('map', 'remove', two, '--max-looks', '0')[0] == 0 and two.read_bytes() == before


def test_sessions_without_a_name_are_called_after_their_map(tmp_path, run):
    for append in (False, True):
        with MapBuilder(tmp_path / 'old.db', CONFIG, append) as builder:
            for frame in frames(0, 3):
                builder.process(frame)
    code, said = run('map', 'merge', tmp_path / 'old.db', '-o', tmp_path / 'new.db')
    assert code == 0 and '6 keyframes' in said
    assert [one.name for one in open_map(tmp_path / 'new.db').sessions] == ['old-1', 'old-2']


@pytest.mark.parametrize(
    'command',
    ['remove {} --session 0', 'rename {} other --session 0', 'unlink {}', 'link {} --again'],
)
def test_a_map_that_has_an_owner_is_left_alone(command, two, run):
    opened = open_map(two)
    with closing(Appender(two, opened.encoding, opened.keyframes, append=True)):
        code, line = run('map', *command.format(two).split())
    assert code == 1 and 'another program adds to this map' in line and line.count('\n') == 1
    assert len(open_map(two)) == 2 * PLACES


def test_a_session_that_went_meanwhile_is_not_renamed(two, run):
    first, _ = slices_of(two)
    assert run('map', 'remove', two, '--session', '0')[0] == 0
    before = two.read_bytes()
    with pytest.raises(MapError, match='was changed meanwhile; run it again'):
        rename_session(first)
    assert two.read_bytes() == before


def test_a_full_disk_leaves_all_as_it_was(two, maps, tmp_path, run):
    before, limits = two.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    usual = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) // 3, limits[1]))
    try:
        merged = run('map', 'merge', two, maps / 'drive2.db', '-o', tmp_path / 'c.db')
        removed = run('map', 'remove', two, '--session', '0')
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, usual)
    for code, line in (merged, removed):
        assert code == 1 and 'cannot write' in line and line.count('\n') == 1
    assert two.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ['two.db']
