# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a command refuses in one line, before anything is written; above all its outputs."""

import os
import shlex
import shutil
import subprocess
import sys

from convseq_ros.app.result_row import COLUMNS
from convseq_ros.cli import main
from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.map.appender import Appender
from convseq_ros.errors import ConfigError
from convseq_ros.io.output_file import ANSWERS, LIBRARY, OutputFile
from convseq_ros.io.regular_file import write_lines
from convseq_ros.io.results import ResultWriter
import cv2
import pictures
import pytest

ANOTHER = 'is read or written by the same command; name another file'
OTHER = 'was not written by this program, and is kept; move it, or name another file'
NO_FILE = 'is not a file, but a device, a pipe or a socket; name a file'
PAGE = 'is of no kind that is written; name a .html or .htm'
ANSWER = 'is of no kind that is written; name a .csv or .mcap'
FIGURE = 'is of no kind that is written; name a .png or .svg or .pdf'
NO_PLACES = 'has no places; add a drive: convseq build-map RECORDING '
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
    (f'{REPLAY} --output pipe', '--output: pipe', NO_FILE),
    (f'{REPLAY} --output=no\x00ne', r'--output: no\x00ne', 'embedded null byte'),
    (f'{REPLAY} --tum no\x07ne/x.tum', r'--tum: no\x07ne/x.tum', r'folder {here}/no\x07ne; make'),
    (f'{REPLAY} --tum none/x.tum', '--tum: none/x.tum', 'there is no folder'),
    (f'{REPLAY} --config m.db', 'm.db: is no text, but like a map', 'give a YAML file'),
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
    ('replay drive --map none/new.db --mode online', 'none/new.db:', 'there is no folder'),
    ("build-map drive new.db --topic '/a /a'", '', 'names a camera twice'),
    ("replay drive --map m.db --camera-info /a --topic '/a /b'", '', '1 for 2 cameras; name one'),
    ('build-map drive new.db --max-looks 3 --no-links', '', 'leave out --no-links'),
    ('build-map drive new.db --max-looks 1000', 'max_looks: 1000', 'outside 0 .. 100'),
    ('map unlink m.db --place 1', '', 'place 1 has no link'),
    ('map link m.db -o other.db', '', 'exists already'),
    ('map remove two.db --session drive', '', "no single session is 'drive'; it has 0 'drive', 1"),
    ("map rename two.db --session 1 ''", '', ''),
    ("map rename two.db --session 1 'a\nb'", '', ''),
    ("build-map drive new.db --session 'a\nb'", '', 'is not a line of 1 to 200 characters'),
    ('build-map drive new.db --pose-frame ENU', '', 'no poses: none were asked for; add --odom'),
    ('map merge two.db other.db -o new.db', '', "its session 'drive' is in"),
    ('map merge two.db two.db -o new.db', '', 'leave one out'),
    ('map merge m.db -o two.db', '', 'exists already'),
    ('map merge m.db small.db -o new.db', '', 'made with image_size_px'),
    ('map merge m.db every.db -o new.db', '', 'made with keyframe_overlap'),
    ('map remove empty.db --session 0', 'empty.db:', NO_PLACES),
    ('map unlink empty.db --session 0', 'empty.db:', NO_PLACES),
    ('map rename empty.db --session 0 x', 'empty.db:', NO_PLACES),
    ('map split empty.db', 'empty.db:', NO_PLACES),
    ('info m.db --picture a.png', '', 'the map has no poses to draw it by; build it with --odom'),
    ('locate missing.png --map m.db', '', 'missing.png: No such file'),
    ('locate poses.txt --map m.db', '', 'poses.txt: '),
    ('locate drive/000.png --map missing.db', '', 'missing.db'),
    ('locate . --map m.db', '', ': a folder; give its last few pictures'),
    ('locate drive/000.png --map m.db --mode online', '', 'locate adds nothing'),
    ('demo --output .', '', 'not of an earlier demo'),
    ('demo --output m.db', 'm.db: cannot be made a folder', 'name another'),
    ('map split m.db -o m.db', 'm.db: cannot be made a folder', 'name another'),
    ('evaluate corridor --output m.db', 'm.db: cannot be made a folder', 'name another'),
    (f'{REPLAY} --output mine.csv', '--output: mine.csv', OTHER),
    (f'{REPLAY} --tum poses.txt', '--tum: poses.txt', OTHER),
    (f'{REPLAY} --report mine.html', '--report: mine.html', OTHER),
    ('map link m.db --g2o poses.txt', '--g2o: poses.txt', OTHER),
    ('map link m.db --g2o mine', '--g2o: mine.csv', OTHER),
    ('map link m.db --g2o a --tum a.csv', '--g2o: a.csv', ANOTHER),
    ('info m.db --picture drive/001.png', '--picture: drive/001.png', OTHER),
    ('locate drive/000.png --map m.db --picture other.png', '--picture: other.png', OTHER),
]


@pytest.fixture(scope='module')
def built(tmp_path_factory):
    """Return a folder with a drive, maps of it, and one of a node that saw nothing."""
    folder = tmp_path_factory.mktemp('built')
    pictures.written(folder / 'drive', map(pictures.scene, range(3)))
    for name in ('m', 'other', 'small --image-size-px 64', 'every --keyframe-overlap 1'):
        name, *more = name.split()
        assert main(['build-map', str(folder / 'drive'), str(folder / f'{name}.db'), *more]) == 0
    both = [str(folder / name) for name in ('m.db', 'other.db', 'two.db')]
    assert main(['map', 'merge', *both[:2], '-o', both[2]]) == 0
    Appender(folder / 'empty.db', EncodingConfig(), KeyframeConfig()).close()
    return folder


@pytest.fixture
def here(built, tmp_path, monkeypatch):
    """Return a folder to work in, with files that must stay."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(built, tmp_path, dirs_exist_ok=True)
    (tmp_path / 'set.yaml').write_text('name: mine')
    (tmp_path / 'poses.txt').write_text('0 0 0 0 0 0 0 1\n')
    (tmp_path / 'mine.csv').write_text('name,query_index,\n')
    shutil.copy('drive/001.png', 'other.png')
    (tmp_path / 'mine.html').write_text('<title>convseq_ros</title>')
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
def test_what_cannot_be_done_is_refused_and_changes_nothing(here, capsys, line, named, told):
    before = contents(here)
    capsys.readouterr()
    assert main(shlex.split(line)) == 1
    said = capsys.readouterr().err
    assert said.count('\n') == 1
    assert f': {named} '.rstrip() in said and told.replace('{here}', str(here)) in said
    assert contents(here) == before


def test_the_target_of_a_symbolic_link_is_replaced_and_the_link_stays(here):
    pytest.importorskip('jinja2')
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
    with pytest.raises(ConfigError, match=r'result_file: .*a.mcap was not written by this'):
        OutputFile('result_file', tmp_path / 'a.mcap').refuse()


def test_what_the_program_wrote_is_replaced_and_an_empty_file(here, capsys):
    pytest.importorskip('jinja2')
    pytest.importorskip('matplotlib')
    poses = ''.join(f'{stamp / 10} {stamp} 0 0 0 0 0 1\n' for stamp in range(1, 4))
    (here / 'poses.txt').write_text(poses)
    (here / 'empty.svg').touch()
    assert main(['build-map', 'drive', 'posed.db', '--poses', 'poses.txt']) == 0
    for line in 2 * (
        'info posed.db --picture a.png',
        'info posed.db --picture empty.svg',
        'info posed.db --picture a.pdf',
        'locate drive/000.png --map m.db --picture located.png',
        f'{REPLAY} --report page.html --output r.csv',
    ):
        assert main(line.split()) == 0, capsys.readouterr().err
    for name in ('a.png', 'located.png'):
        assert cv2.imread(name) is not None
    write_lines(here / 'a.tum', ['0 0 0 0 0 0 0 1'])
    OutputFile('--tum', here / 'a.tum').refuse()
    assert COLUMNS[0] == 'query_index'


def test_help_of_the_drawn_town_draws_nothing(tmp_path):
    words = [sys.executable, '-m', 'convseq_ros.simulation.town', '--help']
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert 'folder to make' in done.stdout and not [*tmp_path.iterdir()]
