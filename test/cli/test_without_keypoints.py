# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every command that would ask the keypoints of a map says once if it has none."""

import shutil

from convseq_ros.cli import main
from pictures import scene, written
import pytest

SETTINGS = '--keyframe-overlap', '1'


@pytest.fixture(scope='module')
def drive(tmp_path_factory):
    return written(tmp_path_factory.mktemp('data') / 'drive', map(scene, range(3)))


@pytest.fixture(scope='module')
def built(drive, tmp_path_factory):
    """Return a folder with a map without keypoints and links, and one with keypoints."""
    folder = tmp_path_factory.mktemp('maps')
    for name, count in (('blind.db', '0'), ('seeing.db', '300')):
        more = *SETTINGS, '--keypoints', count, '--no-links'
        assert main(['build-map', str(drive), str(folder / name), *more]) == 0
    return folder


@pytest.mark.parametrize('name', ['blind.db', 'seeing.db'])
@pytest.mark.parametrize(
    ('command', 'asks'),
    [
        ('replay DRIVE --map MAP --output TABLE', True),
        ('replay DRIVE --map MAP --output TABLE --matching regional', False),
        ('locate DRIVE/000.png --map MAP', True),
        ('locate DRIVE/000.png --map MAP --keypoints 0', False),
        ('map link MAP', True),
        ('map link MAP --again', True),
        ('map merge MAP -o OTHER', True),
        ('map merge MAP -o OTHER --no-links', False),
        ('build-map DRIVE MAP --append', True),
        ('build-map DRIVE MAP --append --no-links', False),
        ('info MAP', False),
    ],
)
def test_a_command_that_would_ask_keypoints_warns_of_a_map_without_any(
    built, drive, tmp_path, capsys, command, asks, name
):
    path = tmp_path / 'maps' / name
    path.parent.mkdir()
    shutil.copy(built / name, path)
    known = {'DRIVE': drive, 'MAP': path}
    known |= {'TABLE': tmp_path / 'table.csv', 'OTHER': tmp_path / 'other.db'}
    words = command.split() + [*SETTINGS] * (command.startswith('build-map'))
    words = [word.replace('DRIVE', str(drive)) if '/' in word else word for word in words]
    assert main([str(known.get(word, word)) for word in words]) == 0
    target = known['OTHER' if 'merge' in command else 'MAP']
    line = f'warning: {target} has no keypoints, so alike aisles may be confused; '
    line += 'build the map again to add them'
    told = [one for one in capsys.readouterr().err.splitlines() if 'keypoints' in one]
    assert told == [line] * (asks and name == 'blind.db')
