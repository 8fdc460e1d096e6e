# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq fleet link` and `evaluate` say what the commands of one machine do."""

import json
from pathlib import Path
import shutil

from convseq_ros.cli import main
import cv2
import numpy as np
import pytest


@pytest.fixture
def said(capsys):
    """Return a way to run a command and get what it prints as JSON, and its warnings."""

    def run(*command):
        assert main([str(one) for one in command]) == 0
        printed = capsys.readouterr()
        return json.loads(printed.out), printed.err

    return run


def test_a_fleet_is_linked_as_its_merged_map(drives, scheduler, said, tmp_path):
    maps, _, again = drives
    folder, one = tmp_path / 'maps', tmp_path / 'one.db'
    folder.mkdir()
    for path in maps.glob('*.db'):
        shutil.copy(path, folder)
    said('build-map', again, folder / 'map_3.db', '--keyframe-overlap', '1', '--json')
    said('map', 'merge', *sorted(folder.glob('*.db')), '-o', one, '--no-links', '--json')
    (folder / 'map_9.db').write_bytes(b'no map')
    graphs = [tmp_path / name for name in ('one.g2o', 'fleet.g2o')]
    expected, _ = said('map', 'link', one, '--json', '--g2o', graphs[0])
    found, warned = said(
        'fleet', 'link', folder, '--json', '--g2o', graphs[1], '--scheduler', scheduler
    )
    assert found == expected
    assert {(link['session'], link['other_session']) for link in found} >= {(1, 3), (3, 1), (3, 2)}
    assert graphs[0].read_text() == graphs[1].read_text()
    assert 'map_9.db' in warned and 'the other maps are linked' in warned


def test_one_session_alone_has_nothing_to_be_linked_with(drives, tmp_path, capsys):
    shutil.copy(sorted(drives[0].glob('*.db'))[0], tmp_path)
    assert main(['fleet', 'link', str(tmp_path)]) == 1
    assert 'has one session' in capsys.readouterr().err


def test_a_study_gives_the_same_table_on_a_fleet(recordings, scheduler, said, tmp_path):
    drive = recordings / 'drive_0'
    again = tmp_path / 'again'
    again.mkdir()
    for number, path in enumerate(sorted(drive.iterdir())):
        noise = np.random.default_rng(number).normal(0, 12, (60, 80))
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(again / path.name), np.clip(image + noise, 0, 255).astype(np.uint8))
    (tmp_path / 'set.yaml').write_text(
        f'name: set\nquery: {{path: {again}}}\nreference: {{path: {drive}}}\n'
        'truth: {kind: identity, tolerance: 1}\n'
    )
    study = tmp_path / 'study.yaml'
    study.write_text(
        'name: lengths\nsets: [set.yaml]\nmethods: [convseq, hog]\n'
        'vary: {fixed_length: [1, 3]}\nchange: {darken: [0.2], stops: [3]}\n'
    )
    tables = tmp_path / 'one', tmp_path / 'fleet'
    options = '--json', '--no-cache', '--image-size-px', '64'
    expected, _ = said('evaluate', '--study', study, '--output', tables[0], *options)
    found, _ = said(
        'fleet', 'evaluate', study, '--output', tables[1], '--scheduler', scheduler, *options
    )
    assert found == expected and len(found) == 8
    one, two = ((table / 'lengths.csv').read_text() for table in tables)
    assert one == two


def test_what_is_wrong_with_a_study_is_told_in_a_line(scheduler, tmp_path, capsys):
    study = Path(tmp_path, 'study.yaml')
    study.write_text('sets: [none.yaml]')
    assert main(['fleet', 'evaluate', str(study), '--scheduler', scheduler]) == 1
    assert 'none.yaml' in capsys.readouterr().err
