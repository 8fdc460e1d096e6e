# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Damage in the log of a map that a crash left: what was safe is there, or the map is refused.

One try for each kind of byte; bench/torture flips any of them.
"""

from io import BytesIO
import time

from convseq_ros.core.map.crash_recovery import _checksum, _damaged_at
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.writer import MapWriter
from convseq_ros.errors import MapError
import numpy as np
import pytest

from bench.torture.maps import APART, crash, ENCODING, log_of

pytestmark = pytest.mark.once

FRAME = 24 + 16_384  # bytes of the log for a page; 32 stand before the first


def flip(at):
    def change(data):
        data[at] ^= 16

    return change


def declare(page_bytes):
    def change(data):
        data[8:12] = page_bytes.to_bytes(4, 'big')
        sums = _checksum(bytes(data[:24]), '<>'[data[3] & 1], np.zeros(2, np.uint32))
        data[24:32] = sums.astype('>u4').tobytes()

    return change


def tear(data):
    data[-9000:] = bytes(9000)


@pytest.mark.parametrize(
    ('commits', 'change', 'left'),
    [
        (1, bytes, 4),  # nothing is damaged
        (3, bytes, 6),
        (3, tear, 5),
        *((1, flip(at), 2) for at in (-1, -FRAME, 32, 32 + FRAME)),
        *((3, flip(at), 5) for at in (-1, -FRAME)),
    ],
)
def test_a_damaged_last_commit_is_passed_over_like_half_a_commit(path, commits, change, left):
    crash(path, 2, *range(4, 4 + commits))
    data = bytearray(log_of(path).read_bytes())
    change(data)
    log_of(path).write_bytes(data)
    assert len(MapReader(path)) == left


@pytest.mark.parametrize(
    ('commits', 'change'),
    [
        *((1, flip(at)) for at in (0, 9, 17, 25)),
        *((3, flip(at)) for at in (0, 32, 36, 32 + 17, 32 + 21, 32 + 30, 32 + FRAME - 1)),
        *((3, declare(size)) for size in (0, 3, 1000, 1 << 31)),
    ],
)
def test_damage_that_commits_follow_is_reported(path, commits, change):
    crash(path, 2, *range(4, 4 + commits))
    data = bytearray(log_of(path).read_bytes())
    change(data)
    log_of(path).write_bytes(data)
    for use in (MapReader, lambda path: MapWriter(path, ENCODING, APART, append=True)):
        with pytest.raises(MapError, match=r'map\.db-wal: damaged at byte \d+; .* opens without'):
            use(path)
    assert log_of(path).read_bytes() == data


@pytest.mark.parametrize('size', [0, 31])
def test_a_log_that_is_emptied_while_it_is_opened_is_not_damaged(size):
    assert _damaged_at(BytesIO(bytes(size))) == -1


def test_a_log_of_a_terabyte_takes_neither_memory_nor_time(path):
    crash(path, 2, 4, 5, 6)
    with log_of(path).open('r+b') as log:
        log.truncate(10**12)
    started_s = time.thread_time()
    assert len(MapReader(path)) == 6
    assert time.thread_time() - started_s < 2
