# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq replay --report`: the page says what the table says, with pictures of both sides."""

from base64 import b64decode
import re

from convseq_ros.app.map_builder import build_map
from convseq_ros.cli import main
from convseq_ros.cli.replay_report import COLORS
from convseq_ros.config import Config, KeyframeConfig
from convseq_ros.core.types import Reason
from convseq_ros.io.results import read_results
from convseq_ros.sources import open_source
import cv2
import numpy as np
from pictures import scene, written
import pytest
from web_page import data_of

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
        rows = [
            f'{at / 1e9:.9f} '
            + (f'5 {x} 0 0 0 .70710678 .70710678' if seed else f'{x} 0 0 0 0 0 1')
            for x, at in enumerate(stamps)
        ]
        (folder / f'{name}.txt').write_text('\n'.join(rows) + '\n')
    poses = ['--poses', str(folder / 'first.txt')]
    assert (
        main(['build-map', str(folder / 'first'), str(folder / 'map.db'), *poses, *SETTINGS]) == 0
    )
    # No command makes a map without pictures, but a program may.
    keyframes = KeyframeConfig(keyframe_overlap=1.0, thumbnail_width_px=0)
    build_map(open_source(folder / 'first'), folder / 'bare.db', Config(keyframes=keyframes))
    return folder


@pytest.fixture
def replayed(drives, tmp_path, capsys):
    """Return a function that replays the second drive, and returns the page's data and text."""

    def run(*args, name='map.db', drive='second', page=tmp_path / 'page.html'):
        words = ['--map', str(drives / name), '--output', str(tmp_path / 'result.csv')]
        code = main(['replay', str(drives / drive), *words, '--report', str(page), *args])
        errors = capsys.readouterr().err
        if code:
            return code, errors
        return data_of(page), page.read_text('utf-8'), errors

    return run


def picture_of(data, number):
    jpeg = np.frombuffer(b64decode(data['pictures'][number].partition(',')[2]), np.uint8)
    return cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE)


def test_page_has_a_pair_for_each_frame_with_candidates_and_its_agreement(
    drives, replayed, tmp_path
):
    data, text, errors = replayed('--poses', str(drives / 'second.txt'))
    table, rows = read_results(tmp_path / 'result.csv'), data['runs'][0]['rows']
    assert errors == '' and f'{COUNT} frames' in text
    kinds = [data['kinds'][kind] for kind in data['strip']['kinds']]
    assert kinds == [row['reason'].replace('_', ' ') for row in table]
    heights = [None if not row['confidence'] else float(row['confidence']) for row in table]
    assert data['strip']['heights'] == pytest.approx([100 * one for one in heights], abs=0.1)
    assert [row[-1] for row in rows] == [at for at, row in enumerate(table) if row['best_index']]
    accepted = [row for row in rows if row[0] == 'accepted']
    assert len(accepted) > COUNT / 2
    for row in accepted:
        place = int(table[row[-1]]['reference_index'])
        assert row[3].startswith(f'Place {place} of first\n')
        assert picture_of(data, row[4]).shape == (180, 240)
        shown, kept = picture_of(data, row[5]), cv2.resize(scene(place), (128, 96))
        assert np.corrcoef(shown.ravel(), kept.ravel())[0, 1] > 0.9
        for marks in row[6:8]:  # what agrees lies where it lay
            ends = np.frombuffer(b64decode(marks), np.uint8).reshape(-1, 2, 2).astype(int)
            assert len(ends) > 4 and abs(ends[:, 0] - ends[:, 1]).mean() < 4


def test_drive_and_map_coincide_from_above_though_their_odometry_differs(drives, replayed):
    data, text, _ = replayed('--poses', str(drives / 'second.txt'))
    lines = re.findall(r'class="line" stroke="[^"]*" d="M([^"]*)"', text)
    drive, mapped = ([tuple(map(float, p.split())) for p in line.split('L')] for line in lines)
    assert len(drive) == len(mapped) == COUNT
    assert np.allclose(drive, mapped, atol=1.0)
    assert mapped[0][0] == 30.0 and mapped[-1][0] == 970.0
    assert text.count('class="arc"') == data['strip']['kinds'].count(0)


def test_each_part_that_a_page_lacks_is_reported_in_one_line(drives, replayed, tmp_path):
    data, text, errors = replayed(name='bare.db')
    above, pictures = errors.splitlines()
    assert 'nothing is drawn from above, which needs --odom or --poses' in above
    assert 'the map keeps no pictures; build it again' in pictures
    assert 'id="above"' not in text
    assert all(row[5] is None and row[4] is not None for row in data['runs'][0]['rows'])
    written(drives / 'elsewhere', (scene(place) for place in range(900, 905)))
    data, text, errors = replayed('--poses', str(drives / 'second.txt'), drive='elsewhere')
    assert errors == f'warning: {tmp_path / "page.html"}: no frame was accepted\n'
    assert data['strip']['threshold'] == 90 and 'id="above"' in text


def test_a_page_that_cannot_be_written_leaves_the_table_and_the_old_page(
    replayed, tmp_path, monkeypatch
):
    page = tmp_path / 'page.html'
    page.write_text('old')

    def full(*_):
        raise OSError(28, 'No space left on device', f'{page}.part')

    with monkeypatch.context() as patch:
        patch.setattr('convseq_ros.io.regular_file.replace_safely', full)
        patch.setattr(
            'convseq_ros.io.results.replace_safely', lambda part, path: part.rename(path)
        )
        code, errors = replayed()
    assert code == 1
    assert [line for line in errors.splitlines() if not line.startswith('warning')] == [
        f'convseq replay: {page}: No space left on device'
    ]
    assert page.read_text() == 'old' and len(read_results(tmp_path / 'result.csv')) == COUNT
    code, errors = replayed(page=page / 'page.html')
    assert code == 1 and f'there is no folder {page}' in errors


def test_each_reason_has_a_colour_of_its_own():
    assert COLORS.keys() == {*Reason} and len({*COLORS.values()}) == len(Reason)
