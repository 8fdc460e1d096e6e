# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What was committed to the log of a crashed map is there, or the map is refused."""

import shutil
import time

from convseq_ros.core.map.crash_recovery import _sums
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.writer import MapWriter
from convseq_ros.errors import MapError
import pytest

from bench.torture.scenarios import APART, drawn, ENCODING

pytestmark = pytest.mark.once

FRAME = 24 + 16_384  # bytes of the log for a page; 32 stand before the first


@pytest.fixture(scope='module', params=[1, 3])
def crashed(request, tmp_path_factory):
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


def damaged(crashed, tmp_path, change):
    shutil.copytree(crashed[0], tmp_path / 'map')
    path = tmp_path / 'map' / 'map.db'
    log = path.with_name('map.db-wal')
    data = bytearray(log.read_bytes())
    change(data)
    log.write_bytes(data)
    return path


@pytest.mark.parametrize(
    'at', [0, 9, 17, 25, 32, 36, 32 + 9, 32 + 17, 32 + 21, 32 + 30, 32 + FRAME - 1, -1, -FRAME]
)
@pytest.mark.parametrize(
    'open_it', [MapReader, lambda path: MapWriter(path, ENCODING, APART, True)]
)
def test_a_flipped_bit_of_what_was_committed_is_told(crashed, tmp_path, at, open_it):
    def flip(data):
        data[at] ^= 16

    path = damaged(crashed, tmp_path, flip)
    before = path.with_name('map.db-wal').read_bytes()
    with pytest.raises(MapError, match=r'map\.db-wal: damaged at byte \d+; .* restore it'):
        open_it(path)
    assert path.with_name('map.db-wal').read_bytes() == before


@pytest.mark.parametrize('size', [0, 3, 1000, 1 << 31])
def test_a_size_of_pages_that_cannot_be_is_told(crashed, tmp_path, size):
    def declare(data):
        data[8:12] = size.to_bytes(4, 'big')
        sums = _sums(bytes(data[:24]), '<>'[data[3] & 1], (0, 0))
        data[24:32] = b''.join(one.to_bytes(4, 'big') for one in sums)

    with pytest.raises(MapError, match='damaged at byte 0'):
        MapReader(damaged(crashed, tmp_path, declare))


def test_a_whole_log_is_read_and_what_was_never_safe_is_passed_over(crashed, tmp_path):
    assert len(MapReader(damaged(crashed, tmp_path, lambda _: None))) == crashed[1]

    def tear(data):
        data[-9000:] = bytes(9000)

    path = damaged((crashed[0], 0), tmp_path / 'torn', tear)
    assert len(MapReader(path)) == (crashed[1] - 1 if crashed[1] > 4 else 2)


def test_a_log_of_a_terabyte_takes_neither_memory_nor_time(crashed, tmp_path):
    path = damaged(crashed, tmp_path, lambda _: None)
    with path.with_name('map.db-wal').open('r+b') as log:
        log.truncate(10**12)
    started_s = time.thread_time()
    assert len(MapReader(path)) == crashed[1]
    assert time.thread_time() - started_s < 2
