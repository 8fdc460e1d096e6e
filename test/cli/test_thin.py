# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq thin` leaves out what other sessions know as well, and keeps what they do not."""

import json
import shutil

from convseq_ros.cli import main
from convseq_ros.config import Config, EncodingConfig
from convseq_ros.core.map.lifelong import KNOWN
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map_builder import MapBuilder
from convseq_ros.core.types import Frame
import cv2
import numpy as np
import pytest

WAY, NEW = range(40), range(100, 120)
DRIVES = {'first': WAY, 'branch': (*WAY[:30], *NEW), 'again': WAY}


def shown(place, seed):
    """Return what a place looks like (96, 128), with noise by a seed."""
    coarse = np.random.default_rng(place).random((20, 20)).astype(np.float32)
    noise = np.random.default_rng([place, seed]).random((96, 128))
    return ((cv2.resize(coarse, (128, 96)) + noise / 2) * 150).astype(np.uint8)


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """Return a map of three drives: one way, its start and a branch, and the same way again."""
    path = tmp_path_factory.mktemp('thin') / 'map.db'
    config = Config(encoding=EncodingConfig(image_size_px=256))
    for number, (name, places) in enumerate(DRIVES.items()):
        with MapBuilder(path, config, number > 0, name) as builder:
            for index, place in enumerate(places):
                stamp_ns = 10**18 + number * 10**12 + index * 10**9
                builder.process(Frame(stamp_ns, shown(place, number)))
    return path


@pytest.fixture
def thin(made, tmp_path, capsys):
    """Return a copy of the map, and a way to thin it that tells the lengths of its sessions."""
    path = shutil.copy(made, tmp_path / 'map.db')

    def run(*options):
        assert main(['thin', str(path), *options, '--json']) == 0
        (told,) = json.loads(capsys.readouterr().out)
        return {one['name']: one['references'] for one in told['sessions']}

    return path, run


def test_a_drive_that_shows_nothing_new_goes_and_the_other_ones_stay(thin):
    path, run = thin
    before = path.read_bytes()
    assert run('--session', 'again', '--dry-run') == {'first': 40, 'branch': 50}
    assert path.read_bytes() == before
    assert run('--session', 'again') == {'first': 40, 'branch': 50}
    assert len(open_map(path)) == 90


def test_what_is_new_of_a_drive_is_kept_with_what_leads_to_it(thin):
    path, run = thin
    left = run('--session', 'branch')
    assert list(left) == ['first', 'branch', 'again']
    assert len(NEW) + KNOWN.window <= left['branch'] < 50
    opened = open_map(path)
    branch = [place.stamp_ns for place in opened.places if place.session == 1]
    assert branch[-1] == 10**18 + 10**12 + 49 * 10**9
    assert opened.sessions[1].start_ns == branch[0]


def test_the_reason_is_told(made, capsys):
    assert main(['thin', str(made), '--session', '2', '--dry-run']) == 0
    said = capsys.readouterr().out
    assert 'again: 0 of 40 places are needed; elsewhere 39 are known, 1 are not' in said
