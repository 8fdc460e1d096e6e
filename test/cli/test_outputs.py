# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs that would replace a map, an input or each other, or that cannot be written."""

import os
import shutil

from convseq_ros.cli import main
from convseq_ros.errors import ConfigError
from convseq_ros.io.output_file import ANSWERS, LIBRARY, OutputFile
from convseq_ros.io.results import ResultWriter
import pictures
import pytest

ANOTHER = 'is read or written by the same command; name another file'
OTHER = 'holds what is not replaced, perhaps a map or a recording; move it, or name another file'
NO_FILE = 'is not a file, but a device, a pipe or a socket; name a file'
PAGE = 'is of no kind that is written; name a .html or .htm'
ANSWER = 'is of no kind that is written; name a .csv or .mcap'
FIGURE = 'is of no kind that is written; name a .png or .svg or .pdf'
REPLAY = 'replay drive --map m.db'
CASES = [
    ('locate drive/000.png --map m.db --picture m.db', '--picture: m.db', ANOTHER),
    (
        'locate drive/000.png --map m.db --picture drive/000.png',
        '--picture: drive/000.png',
        ANOTHER,
    ),
    ('locate drive/000.png --map m.db --picture a.jpg', '--picture: a.jpg', 'name a .png'),
    (f'{REPLAY} --output m.db', '--output: m.db', ANOTHER),
    (f'{REPLAY} --output ./link.db', '--output: link.db', ANOTHER),
    (f'{REPLAY} --output other.db', '--output: other.db', ANSWER),
    (f'{REPLAY} --output drive/001.png', '--output: drive/001.png', ANSWER),
    (f'{REPLAY} --output robot.mcap', '--output: robot.mcap', OTHER),
    (f'{REPLAY} --tum robot.mcap', '--tum: robot.mcap', OTHER),
    (f'{REPLAY} --tum ours.mcap', '--tum: ours.mcap', OTHER),
    (f'{REPLAY} --output a.json', '--output: a.json', ANSWER),
    (f'{REPLAY} --report m.db', '--report: m.db', ANOTHER),
    (f'{REPLAY} --report other.db', '--report: other.db', PAGE),
    (f'{REPLAY} --tum r.csv --output r.csv', '--output: r.csv', ANOTHER),
    (f'{REPLAY} --report r.html --output r.html', '--output: r.html', ANOTHER),
    (f'{REPLAY} --output=', '--output: .', 'is a folder; name a file'),
    (f'{REPLAY} --output pipe', '--output: pipe', NO_FILE),
    (f'{REPLAY} --output=no\x00ne', r'--output: no\x00ne', 'embedded null byte'),
    (f'{REPLAY} --tum no\x07ne/x.tum', r'--tum: no\x07ne/x.tum', r'folder {here}/no\x07ne; make'),
    (f'{REPLAY} --tum none/x.tum', '--tum: none/x.tum', 'there is no folder'),
    (f'{REPLAY} --report none/x.html', '--report: none/x.html', 'there is no folder'),
    (f'{REPLAY} --poses poses.txt --tum poses.txt', '--tum: poses.txt', ANOTHER),
    ('map link m.db --g2o m.db', '--g2o: m.db', ANOTHER),
    ('map link m.db --tum new.db --output new.db', '--tum: new.db', ANOTHER),
    ('map link m.db --picture p.xyz', '--picture: p.xyz', FIGURE),
    ('map link m.db -o none/new.db', '--output: none/new.db', 'there is no folder'),
    ('map merge m.db other.db -o none/new.db', '--output: none/new.db', 'there is no folder'),
    ('info m.db --picture p', '--picture: p', FIGURE),
    ('info drive --picture a.png', '--picture: draws', 'a map; name one instead of drive'),
    (f'{REPLAY} --report set.yaml', '--report: set.yaml', PAGE),
]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Return a folder to work in, with files that must stay."""
    monkeypatch.chdir(tmp_path)
    pictures.written(tmp_path / 'drive', map(pictures.scene, range(3)))
    assert main(['build-map', 'drive', 'm.db']) == 0
    shutil.copy('m.db', 'other.db')
    (tmp_path / 'set.yaml').write_text('name: mine')
    (tmp_path / 'poses.txt').write_text('0 0 0 0 0 0 0 1\n')
    (tmp_path / 'results').mkdir()
    (tmp_path / 'link.db').symlink_to('m.db')
    write_mcap(tmp_path / 'robot.mcap', 'convseq_ros', 'libmcap 1.4.0')
    write_mcap(tmp_path / 'ours.mcap', 'ros2', LIBRARY)
    os.mkfifo(tmp_path / 'pipe')
    return tmp_path


def write_mcap(path, profile, library):
    """Write a recording's magic bytes and header, as the specification of MCAP has them."""
    texts = [len(text).to_bytes(4, 'little') + text.encode() for text in (profile, library)]
    header = b''.join(texts)
    path.write_bytes(b'\x89MCAP0\r\n\x01' + len(header).to_bytes(8, 'little') + header)


def contents(folder):
    """Return what each file of a folder holds, and which pipes there are."""
    files = [path for path in folder.rglob('*') if not path.is_dir()]
    return {path: path.is_fifo() or path.read_bytes() for path in files}


@pytest.mark.parametrize(('line', 'named', 'told'), CASES, ids=[line for line, *_ in CASES])
def test_an_output_that_costs_a_file_is_refused_before_work_starts(
    here, capsys, line, named, told
):
    before = contents(here)
    capsys.readouterr()
    assert main(line.split()) == 1
    said = capsys.readouterr().err
    assert said.count('\n') == 1
    assert f': {named} ' in said and told.replace('{here}', str(here)) in said
    assert contents(here) == before


def test_the_target_of_a_symbolic_link_is_replaced_and_the_link_stays(here):
    (here / 'far').mkdir()
    for name in ('r.csv', 'page.html'):
        (here / name).symlink_to(f'far/{name}')
    words = ['--output', 'r.csv', '--report', 'page.html']
    assert main(['replay', 'drive', '--map', 'm.db', *words]) == 0
    for name in ('r.csv', 'page.html'):
        assert (here / name).is_symlink() and (here / 'far' / name).stat().st_size
    ResultWriter(here / 'r.csv', ['a'], keeps_earlier=True).close()
    assert (here / 'far' / 'r.1.csv').exists() and (here / 'r.csv').is_symlink()


def test_a_recording_of_an_earlier_replay_is_replaced(tmp_path):
    write_mcap(tmp_path / 'a.mcap', 'ros2', LIBRARY)
    OutputFile('--output', tmp_path / 'a.mcap', ANSWERS).refuse()
    with pytest.raises(ConfigError, match=r'result_file: .*a.mcap holds what is not replaced'):
        OutputFile('result_file', tmp_path / 'a.mcap').refuse()
