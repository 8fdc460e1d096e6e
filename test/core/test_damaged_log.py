# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damage in the log of a map that a crash left: what was safe is there, or the map is refused."""

import shutil
import time

from convseq_ros.core.map.crash_recovery import _checksum
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.writer import MapWriter
from convseq_ros.errors import MapError
import numpy as np
import pytest

from bench.torture.maps import APART, drawn, ENCODING

pytestmark = pytest.mark.once

FRAME = 24 + 16_384  # bytes of the log for a page; 32 stand before the first


@pytest.fixture(scope='module', params=[1, 3])
def ended(request, tmp_path_factory):
    """Return a map as a crash leaves it with so many commits in its log."""
    folder = tmp_path_factory.mktemp('crashed')
    path = folder / 'own' / 'map.db'
    path.parent.mkdir()
    with MapWriter(path, ENCODING, APART) as writer:
        writer.copy(drawn(2), 2)
    with MapWriter(path, ENCODING, APART, append=True) as writer:
        writer.write_ahead()
        for commit in range(request.param):
            writer.copy(drawn(4 + commit), 4 + commit)
        shutil.copytree(path.parent, folder / 'left')
    return folder / 'left', 3 + request.param


def flip(data, at):
    data[at] ^= 16


def damaged(ended, tmp_path, change):
    shutil.copytree(ended[0], tmp_path / 'map')
    path = tmp_path / 'map' / 'map.db'
    log = path.with_name('map.db-wal')
    data = bytearray(log.read_bytes())
    change(data)
    log.write_bytes(data)
    return path


@pytest.mark.parametrize('at', [0, 9, 17, 25, 32, 36, 32 + 17, 32 + 21, 32 + 30, 32 + FRAME - 1])
@pytest.mark.parametrize(
    'open_it', [MapReader, lambda path: MapWriter(path, ENCODING, APART, True)]
)
def test_damage_that_commits_follow_is_reported(ended, tmp_path, at, open_it):
    if at >= 32 and ended[1] == 4:
        pytest.skip('a damaged last commit is passed over')
    path = damaged(ended, tmp_path, lambda data: flip(data, at))
    before = path.with_name('map.db-wal').read_bytes()
    with pytest.raises(MapError, match=r'map\.db-wal: damaged at byte \d+; .* opens without them'):
        open_it(path)
    assert path.with_name('map.db-wal').read_bytes() == before


@pytest.mark.parametrize('at', [-1, -FRAME, 32, 32 + FRAME])
def test_a_damaged_last_commit_is_passed_over_like_half_a_commit(ended, tmp_path, at):
    if at >= 0 and ended[1] > 4:
        pytest.skip('commits follow')
    path = damaged(ended, tmp_path, lambda data: flip(data, at))
    assert len(MapReader(path)) == (ended[1] - 1 if ended[1] > 4 else 2)


@pytest.mark.parametrize('size', [0, 3, 1000, 1 << 31])
def test_a_size_of_pages_that_cannot_be_is_reported(ended, tmp_path, size):
    def declare(data):
        data[8:12] = size.to_bytes(4, 'big')
        sums = _checksum(bytes(data[:24]), '<>'[data[3] & 1], np.zeros(2, np.uint32))
        data[24:32] = sums.astype('>u4').tobytes()

    with pytest.raises(MapError, match='damaged at byte 0'):
        MapReader(damaged(ended, tmp_path, declare))


def test_a_whole_log_is_read_and_an_uncommitted_end_is_ignored(ended, tmp_path):
    assert len(MapReader(damaged(ended, tmp_path, lambda _: None))) == ended[1]

    def tear(data):
        data[-9000:] = bytes(9000)

    path = damaged((ended[0], 0), tmp_path / 'torn', tear)
    assert len(MapReader(path)) == (ended[1] - 1 if ended[1] > 4 else 2)


def test_a_log_of_a_terabyte_takes_neither_memory_nor_time(ended, tmp_path):
    path = damaged(ended, tmp_path, lambda _: None)
    with path.with_name('map.db-wal').open('r+b') as log:
        log.truncate(10**12)
    started_s = time.thread_time()
    assert len(MapReader(path)) == ended[1]
    assert time.thread_time() - started_s < 2
