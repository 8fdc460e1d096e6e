# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq fleet link` and `evaluate` say what the commands of one machine do."""

import json
import shutil

from convseq_ros.cli import main
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
    assert {(link['session'], link['other_session']) for link in found} >= {(3, 1), (3, 2)}
    assert graphs[0].read_text() == graphs[1].read_text()
    assert 'map_9.db' in warned and 'the other maps are linked' in warned
