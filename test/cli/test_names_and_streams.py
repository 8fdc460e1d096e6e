# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Names that are not UTF-8 or have two lines, and streams that are closed, full or of latin-1."""

import errno
import json
import os
from pathlib import Path
import re
import shlex
import subprocess
import sys

from convseq_ros.cli import main
from convseq_ros.config.arguments import Parser
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.map.reader import open_map
from convseq_ros.errors import printable
from convseq_ros.io.regular_file import complete_or_absent
from convseq_ros.io.results import read_results
from pictures import scene, written
import pytest

CONVSEQ = [sys.executable, '-m', 'convseq_ros.cli']
REPOSITORY = Path(__file__).resolve().parents[2]
PROGRAMS = 'bench', 'convseq_ros', 'docs', 'examples', 'scripts'
PARSER = re.compile(r'argparse\.ArgumentParser\(([^)]*)')
NAMES = [b'M\xfcnchen', b'new\nline', b"it's \\ a #?%20&b"]


@pytest.fixture(scope='module')
def drive(tmp_path_factory):
    return written(tmp_path_factory.mktemp('data') / 'drive', map(scene, range(3)))


@pytest.mark.parametrize('name', NAMES)
def test_a_folder_of_any_name_becomes_a_map_and_is_replayed(name, drive, tmp_path, capsys):
    base = Path(os.fsdecode(bytes(tmp_path) + b'/' + name))
    base.symlink_to(drive)
    path, table = f'{base}.db', f'{base}.csv'
    assert main(['build-map', str(base), path]) == 0
    assert open_map(path).sessions[0].name == printable(base.name)
    assert main(['replay', str(base), '--map', path, '--output', table]) == 0
    assert len(read_results(Path(table))) == 3
    assert main(['build-map', str(base), path]) == 1
    told = capsys.readouterr()
    assert told.err.startswith(f'convseq build-map: {printable(path)}: exists already')
    assert told.err.count('\n') == 1
    assert [line for line in told.out.splitlines() if line.startswith(printable(path))]


@pytest.mark.parametrize('name', NAMES)
def test_the_line_to_paste_names_a_folder_of_any_name(name, drive, tmp_path, capsys):
    base = Path(os.fsdecode(bytes(tmp_path) + b'/' + name))
    base.symlink_to(drive)
    assert main(['info', str(base)]) == 0
    (line,) = [one for one in capsys.readouterr().out.splitlines() if 'build-map' in one]
    printing = line.replace('convseq build-map', 'printf %s').replace(' map.db', '')
    shown = subprocess.run(['bash', '-c', printing], capture_output=True, check=True)
    assert shown.stdout == os.fsencode(base)


def test_pictures_of_any_name_are_reported_by_their_name(tmp_path, capsys):
    folder = written(tmp_path / 'drive', map(scene, range(2)))
    odd = Path(os.fsdecode(bytes(folder) + b'/001\xfc.png'))
    (folder / '001.png').rename(odd)
    assert main(['build-map', str(folder), str(tmp_path / 'map.db')]) == 0
    assert [place.source for place in open_map(tmp_path / 'map.db').places][1] == r'001\xfc.png'
    odd.write_bytes(b'no picture')
    capsys.readouterr()
    assert main(['build-map', str(folder), str(tmp_path / 'other.db')]) == 0
    assert r'001\xfc.png: not a readable picture' in capsys.readouterr().err


@pytest.mark.parametrize('word', ['--session', '--topic', '--odom', '--camera-info'])
def test_words_that_are_not_utf_8_are_refused_in_one_line(word, drive, tmp_path, capsys):
    path = tmp_path / 'map.db'
    assert main(['build-map', str(drive), str(path), word, 'caf\udce9']) == 1
    told = capsys.readouterr().err
    assert told == "convseq build-map: 'caf\\xe9' is not UTF-8; write it in UTF-8\n"
    assert not path.exists()


def test_home_paths_and_file_addresses_are_found(drive, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv('HOME', str(tmp_path))
    assert main(['build-map', str(drive), '~/my map.db']) == 0
    address = f'file://{tmp_path}/my%20map.db'
    for name in ('~/my map.db', address, address.replace('//', '//localhost', 1)):
        capsys.readouterr()
        assert main(['info', name, '--json']) == 0
        assert json.loads(capsys.readouterr().out)['map'] == str(tmp_path / 'my map.db')
    config = NodeConfig(map_path='~/a.db', result_file=address)
    assert config.map_path == f'{tmp_path}/a.db'
    assert config.result_file == f'{tmp_path}/my map.db'
    graph = PoseGraphConfig(map_path='~/a.db', tum_file='~/a.txt', g2o_file='~/a.g2o')
    found = graph.map_path, graph.tum_file, graph.g2o_file
    assert found == tuple(f'{tmp_path}/a.{kind}' for kind in ('db', 'txt', 'g2o'))


def test_options_have_no_abbreviations():
    parser = Parser()
    parser.add_argument('--picture')
    verb = parser.add_subparsers().add_parser('verb')
    verb.add_argument('--output')
    for words in (['--pic', 'x'], ['verb', '--out', 'x']):
        with pytest.raises(SystemExit):
            parser.parse_args(words)
    assert parser.parse_args(['verb', '--output', 'x']).output == 'x'


def test_no_program_of_the_repository_has_a_parser_that_takes_abbreviations():
    files = [one for room in PROGRAMS for one in (REPOSITORY / room).rglob('*.py')]
    calls = [call for one in files for call in PARSER.findall(one.read_text(encoding='utf-8'))]
    assert len(calls) > 5
    assert all(call.strip().startswith('allow_abbrev=False') for call in calls), calls


def bash(line):
    """Return what is said on a line of bash."""
    return subprocess.run(['bash', '-c', line], capture_output=True, text=True, check=False)


def test_a_closed_output_costs_no_map(drive, tmp_path):
    path = tmp_path / 'map.db'
    command = shlex.join([*CONVSEQ, 'build-map', str(drive), str(path)])
    done = bash(f'{command} >&- <&-')
    assert (done.returncode, done.stderr, len(open_map(path))) == (0, '', 3)


@pytest.mark.parametrize('unbuffered', ['', '1'])
@pytest.mark.parametrize(
    ('end', 'code', 'told'),
    [
        ('> /dev/full', 1, 'convseq info: standard output: No space left on device\n'),
        ('2> /dev/full > /dev/full', 1, ''),
        ('| true; (exit ${PIPESTATUS[0]})', 0, ''),
    ],
)
def test_a_full_or_closed_output_gives_at_most_one_line(end, code, told, unbuffered, monkeypatch):
    monkeypatch.setenv('PYTHONUNBUFFERED', unbuffered)
    done = bash(f'{shlex.join([*CONVSEQ, "info", "--json"])} {end}')
    assert (done.returncode, done.stderr) == (code, told)


def test_an_output_of_ascii_gets_numbers_of_letters(drive, tmp_path):
    folder = tmp_path / '東京'
    folder.symlink_to(drive)
    done = bash(f'PYTHONIOENCODING=ascii {shlex.join([*CONVSEQ, "info", str(folder)])}')
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout.startswith(f'{tmp_path}/\\u6771\\u4eac: 3 images\n')


@pytest.mark.parametrize('name', ['', 'part'])
def test_a_full_disk_is_reported_with_the_name_of_the_file(name, tmp_path):
    path = tmp_path / 'a'
    with pytest.raises(OSError, match='No space') as caught, complete_or_absent(path) as part:
        raise OSError(errno.ENOSPC, 'No space', *([str(part)] if name else []))
    assert caught.value.filename == str(path)
    assert not any(tmp_path.iterdir())
