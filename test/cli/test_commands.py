# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The commands: what they do, and the one line that they say when they cannot."""

import argparse
import json
import os
import resource
import shlex
import signal
import subprocess
import sys
import time
from unittest.mock import Mock

from convseq_ros.app.map_builder import MapBuilder
from convseq_ros.cli import COMMANDS, main, replay
from convseq_ros.cli.options import chosen_images
from convseq_ros.core.map.reader import open_map
from convseq_ros.io.results import read_results
from pictures import scene, written
from programs import run
import pytest

COUNT = 24
START = [sys.executable, '-c', 'import sys; from convseq_ros.cli import main; sys.exit(main())']


@pytest.fixture(scope='module')
def drive(tmp_path_factory):
    return written(tmp_path_factory.mktemp('data') / 'drive', map(scene, range(COUNT)))


@pytest.fixture(scope='module')
def map_path(drive):
    path = drive.parent / 'map.db'
    assert main(['build-map', str(drive), str(path)]) == 0
    return path


def refused(capsys, *arguments):
    """Return the one line that a command says when it cannot do its work."""
    assert main([str(each) for each in arguments]) == 1
    said = capsys.readouterr()
    assert said.out == '' and said.err.count('\n') == 1
    return said.err


def test_a_drive_replayed_in_its_own_map_finds_every_place(drive, map_path, tmp_path, capsys):
    output = tmp_path / 'result.csv'
    arguments = ['replay', drive, '--map', map_path, '--output', output, '--fixed-length', '3']
    assert main([*map(str, arguments), '--json']) == 0
    assert json.loads(capsys.readouterr().out)['frames'] == COUNT
    rows = read_results(output)
    assert [row['query_index'] for row in rows] == [str(index) for index in range(COUNT)]
    assert all(row['best_index'] == row['query_index'] for row in rows[2:])
    assert rows[0]['reason'] in ('weak', 'accepted')
    accepted = [row for row in rows if row['status'] == 'accepted']
    assert len(accepted) > COUNT // 2
    assert all(row['reference_index'] == row['query_index'] for row in accepted)


def test_each_recording_of_a_folder_becomes_a_session_with_each(tmp_path, capsys):
    for number, name in enumerate(('day 2', 'day 10')):
        written(tmp_path / 'drives' / name, (scene(place, number) for place in range(3)))
    arguments = ['build-map', tmp_path / 'drives', tmp_path / 'map.db']
    assert 'day 2 (3)' in refused(capsys, *arguments)
    assert 'leave out --session' in refused(capsys, *arguments, '--each', '--session', 'x')
    assert main([*map(str, arguments), '--each']) == 0
    opened = open_map(tmp_path / 'map.db')
    assert [session.name for session in opened.sessions] == ['day 2', 'day 10']
    assert len(opened) == 6


@pytest.mark.parametrize('said', ['0 0 0 0 0 0', '0.5 0 0 0 0 0'])
def test_a_given_camera_mount_overrides_tf(tmp_path, said):
    replay.describe(parser := argparse.ArgumentParser(allow_abbrev=False))
    words = ['drive', '--map', 'map.db', '--base-frame', 'base']
    tf = chosen_images(parser.parse_args(words))['tf']
    assert (tf.base_frame, tf.camera_to_base) == ('base', '')
    tf = chosen_images(parser.parse_args([*words, '--camera-to-base', said]))['tf']
    assert tf.camera_to_base == said
    file = tmp_path / 'vpr_node.yaml'
    file.write_text(f'vpr_node: {{ros__parameters: {{camera_to_base: "{said}"}}}}')
    tf = chosen_images(parser.parse_args([*words, '--config', str(file)]))['tf']
    assert tf.camera_to_base == ('' if said == '0 0 0 0 0 0' else said)


def test_a_map_of_keyframes_is_replayed_and_appended_to_alike(drive, tmp_path, capsys):
    path, output = tmp_path / 'map.db', tmp_path / 'result.csv'
    build = ['build-map', str(drive), str(path)]
    assert main([*build, '--keyframe-interval-s', '0.2']) == 0
    assert len(open_map(path)) == COUNT // 2
    arguments = ['replay', str(drive), '--map', str(path), '--output', str(output)]
    # Twelve places are too few for a belief.
    assert main([*arguments, '--fixed-length', '3', '--acceptance-rule', 'margin']) == 0
    rows = read_results(output)
    assert {row['reason'] for row in rows[1::2]} == {'between_keyframes'}
    assert [row['best_index'] for row in rows[4::2]] == [*map(str, range(2, COUNT // 2))]
    capsys.readouterr()
    assert main([*arguments, '--keyframe-interval-s', '0.4']) == 0
    assert 'keyframe_interval_s 0.4 is ignored' in capsys.readouterr().err
    assert read_results(output)[1]['reason'] == 'between_keyframes'
    assert main([*build, '--append']) == 1
    assert 'set keyframe_interval_s to 0.2' in capsys.readouterr().err
    assert main([*build, '--append', '--keyframe-interval-s', '0.2']) == 0
    assert len(open_map(path)) == 2 * (COUNT // 2)


def test_keyframes_by_odometry_without_odometry_are_warned_about(drive, tmp_path, capsys):
    path, output = tmp_path / 'map.db', tmp_path / 'result.csv'
    assert main(['build-map', str(drive), str(path), '--keyframe-distance-m', '1.5']) == 0
    assert len(open_map(path)) == COUNT
    assert main(['replay', str(drive), '--map', str(path), '--output', str(output)]) == 0
    assert 'a place every 1.5 m; without --odom or --poses every frame' in capsys.readouterr().err
    assert 'between_keyframes' not in {row['reason'] for row in read_results(output)}


def test_parameters_come_from_a_ros_file_and_options_win(drive, map_path, tmp_path):
    file, output = tmp_path / 'my.yaml', tmp_path / 'result.csv'
    file.write_text(
        '/**:\n  ros__parameters:'
        ' {fixed_length: 4, queue_size: 3, acceptance_rule: margin, min_margin: 1}\n'
        'pose_graph_node:\n  ros__parameters: {map_path: a.db, period_s: 2.0}\n'
    )
    arguments = ['replay', drive, '--map', map_path, '--output', output, '--config', file]
    assert main([str(each) for each in arguments]) == 0
    rows = read_results(output)
    assert {row['sequence_length'] for row in rows} == {'0', '4'}
    assert not any(row['status'] == 'accepted' for row in rows)
    assert main([*map(str, arguments), '--fixed-length', '5']) == 0
    assert {row['sequence_length'] for row in read_results(output)} == {'0', '5'}


def test_a_build_of_hardly_any_place_says_why(tmp_path, capsys):
    folder = written(tmp_path / 'drive', [scene(0)] * 30)
    assert main(['build-map', str(folder), str(tmp_path / 'map.db')]) == 0
    assert 'only 1 of 30 frames became places, too few' in capsys.readouterr().err


@pytest.mark.parametrize('command', COMMANDS)
def test_every_command_has_help(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, '--help'])
    said = capsys.readouterr().out
    assert not ended.value.code and f'{command} ' in said and ' ros.' not in said


def test_without_a_command_all_of_them_are_listed(capsys):
    assert main([]) == 2
    told = capsys.readouterr().err
    assert all(f'\n  {command} ' in told for command in COMMANDS)
    assert main(['config']) == 0 and 'ros__parameters' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('words', 'code'),
    [
        ('--version', 0),
        ('replay --no-such-option', 2),
        ('no-such-command', 2),
        ("build-map '' new.db", 2),
        ('replay drive --map m.db --output=', 2),
    ],
)
def test_wrong_usage_has_an_exit_code_of_its_own(words, code, capsys):
    with pytest.raises(SystemExit) as ended:
        main(shlex.split(words))
    assert ended.value.code == code and 'Traceback' not in capsys.readouterr().err


def test_an_unreadable_picture_is_reported_and_counted(capsys, tmp_path):
    folder = written(tmp_path / 'drive', map(scene, range(3)))
    (folder / '001.png').write_text('no picture')
    assert main(['build-map', str(folder), str(tmp_path / 'map.db'), '--json']) == 0
    told = capsys.readouterr()
    assert told.err.startswith(f'warning: {folder / "001.png"}: not a readable picture')
    built = json.loads(told.out)
    assert (built['frames'], built['added'], built['unreadable']) == (3, 2, 1)


def limited(arguments, size):
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    # Python would write its own caches of modules short, without an error.
    env = {**os.environ, 'PYTHONDONTWRITEBYTECODE': '1'}
    return run(*START, *arguments, preexec_fn=limit, env=env, timeout=180)


def test_a_full_disk_stops_a_map_with_one_line_and_keeps_committed_places(drive, tmp_path):
    path = tmp_path / 'map.db'
    done = limited(['build-map', drive, path], 200_000)
    *kept, error = done.stderr.splitlines()
    assert done.returncode == 1 and 'map.db: cannot write' in error, done.stderr
    if path.exists():
        assert f'keeps the places of this run ({len(open_map(path))});' in kept[0]


def _hear_sigint():
    """Undo what a shell does to programs that it starts in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_an_interrupted_build_keeps_and_reports_what_was_added(tmp_path):
    folder = written(tmp_path / 'drive', map(scene, range(800)))
    path = tmp_path / 'map.db'
    with subprocess.Popen(
        [*START, 'build-map', str(folder), str(path)],
        stderr=subprocess.PIPE,
        text=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'},
        preexec_fn=_hear_sigint,
    ) as process:
        deadline = time.monotonic() + 60
        while not path.exists() or path.stat().st_size < 400_000:  # with places
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=180)[1]
    assert process.returncode == 1 and 'interrupted; the map holds what was added' in said
    assert 0 < len(open_map(path)) < 800


def test_a_build_interrupted_before_its_first_place_says_so(tmp_path, monkeypatch, capsys):
    folder = written(tmp_path / 'drive', map(scene, range(2)))
    monkeypatch.setattr(MapBuilder, 'process', Mock(side_effect=KeyboardInterrupt))
    assert main(['build-map', str(folder), str(tmp_path / 'map.db')]) == 1
    assert capsys.readouterr().err == 'convseq build-map: interrupted\n'
    assert [*tmp_path.iterdir()] == [folder]
