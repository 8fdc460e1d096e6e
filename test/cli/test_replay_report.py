# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq replay --report`: the page says what the table says, with pictures of both sides."""

import re
from unittest.mock import Mock

from convseq_ros import Config, open_map, PlaceRecognizer
from convseq_ros.cli import main
from convseq_ros.cli.replay_report import COLORS, ReplayReport
from convseq_ros.core.types import Reason
from convseq_ros.io.regular_file import MARK
from convseq_ros.io.results import read_results
from convseq_ros.sources import open_each_camera, open_source
import numpy as np
from pictures import scene, written
import pytest

for name in ('jinja2', 'matplotlib'):
    pytest.importorskip(name)

COUNT = 40
SETTINGS = '--keyframe-overlap', '1'


@pytest.fixture(scope='module')
def drives(tmp_path_factory):
    """Return a folder with a drive, `first`, its map, a second one along it, and their poses."""
    folder = tmp_path_factory.mktemp('drives')
    for seed, name in enumerate(('first', 'second')):
        written(folder / name, (scene(place, seed) for place in range(COUNT)))
        stamps = [frame.stamp_ns for frame in open_source(folder / name)]
        # The second one's odometry starts elsewhere, and looks along y.
        row = '{:.9f} 5 {} 0 0 0 .70710678 .70710678\n' if seed else '{:.9f} {} 0 0 0 0 0 1\n'
        rows = [row.format(at / 1e9, x) for x, at in enumerate(stamps)]
        (folder / f'{name}.txt').write_text(''.join(rows))
    build = ['build-map', str(folder / 'first')]
    poses = '--poses', str(folder / 'first.txt')
    assert main([*build, str(folder / 'map.db'), *poses, *SETTINGS]) == 0
    assert main([*build, str(folder / 'bare.db'), *SETTINGS]) == 0
    return folder


@pytest.fixture
def replayed(drives, tmp_path, capsys):
    """Return a function that replays the second drive, and returns the page's text and errors."""

    def run(*args, name='map.db', drive='second', page=tmp_path / 'page.html'):
        words = ['--map', str(drives / name), '--output', str(tmp_path / 'result.csv')]
        code = main(['replay', str(drives / drive), *words, '--report', str(page), *args])
        errors = capsys.readouterr().err
        if code:
            return code, errors
        return page.read_text('utf-8'), errors

    return run


def test_page_has_a_pair_for_each_frame_with_candidates(drives, replayed, tmp_path):
    text, errors = replayed('--poses', str(drives / 'second.txt'))
    table = read_results(tmp_path / 'result.csv')
    accepted = [row for row in table if row['reason'] == 'accepted']
    assert errors == '' and len(accepted) > COUNT / 2
    assert f'{COUNT} frames · {len(accepted)} accepted · map of {COUNT}' in text
    assert f'<summary>accepted: {len(accepted)}' in text
    captions = re.findall(r'<figcaption>Frame (\d+), .*: (.*)\nPlace (\d+) of first\n', text)
    told = {row['query_index']: (row['reason'], row['best_index']) for row in table}
    assert captions
    for frame, reason, place in captions:
        assert told[frame] == (reason.replace(' ', '_'), place)
    assert text.count('class="chart"') == 2


def test_what_a_page_lacks_is_reported_in_one_line(drives, replayed, tmp_path):
    text, errors = replayed(name='bare.db')
    assert 'nothing is drawn from above, which needs --odom or --poses' in errors
    assert text.count('class="chart"') == 1 and errors.count('\n') == 1
    written(drives / 'elsewhere', (scene(place) for place in range(900, 905)))
    text, errors = replayed('--poses', str(drives / 'second.txt'), drive='elsewhere')
    assert errors == f'warning: {tmp_path / "page.html"}: no frame was accepted\n'


def test_drive_and_map_coincide_from_above_though_their_odometry_differs(drives):
    reference_map = open_map(drives / 'map.db')
    recognizer, report = PlaceRecognizer(reference_map, Config()), ReplayReport()
    (frames,) = open_each_camera(drives / 'second', poses=str(drives / 'second.txt'))
    for frame in frames:
        report.add(frame, recognizer.process(frame), recognizer, 0.0)
    drive = report.drive(recognizer)
    places = reference_map.places.columns['pose'][:, :2]
    assert np.allclose(drive, places, atol=0.01)


def test_a_page_that_cannot_be_written_leaves_table_and_old_page(replayed, tmp_path, monkeypatch):
    page = tmp_path / 'page.html'
    page.write_text(old := f'<!-- {MARK} -->')
    full = Mock(side_effect=OSError(28, 'No space left on device', f'{page}.part'))
    with monkeypatch.context() as patch:
        patch.setattr('convseq_ros.io.regular_file.replace_safely', full)
        code, errors = replayed()
    (line,) = [line for line in errors.splitlines() if not line.startswith('warning')]
    assert code == 1 and line == f'convseq replay: {page}: No space left on device'
    assert page.read_text() == old and len(read_results(tmp_path / 'result.csv')) == COUNT
    code, errors = replayed(page=page / 'page.html')
    assert code == 1 and f'there is no folder {page}' in errors


def test_each_reason_has_a_colour_of_its_own():
    assert COLORS.keys() == {*Reason} and len({*COLORS.values()}) == len(Reason)
