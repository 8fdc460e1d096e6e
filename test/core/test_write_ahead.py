# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map that grows is written ahead, so that frames never wait for the disk; at rest, one file."""

import os
import shutil

from convseq_ros.core.map import writer as module
from convseq_ros.core.map.autosave import Autosave
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.errors import MapError
import pytest

from bench.torture.scenarios import APART, cells, ENCODING, grow

pytestmark = pytest.mark.once

MODES = slice(18, 20)  # of the file: how it is written and read
JOURNAL, AHEAD = b'\1\1', b'\2\2'


def own(path, count=0):
    owner = Autosave(path, ENCODING, APART)
    grow(owner.reference_map, count)
    owner.flush()
    return owner


def is_right(reference_map, count):
    return len(reference_map) == count and all(
        (reference_map.packed(index) == cells(index)).all() for index in range(count)
    )


def beside(path):
    return sorted(one.name.removeprefix(path.name) for one in path.parent.iterdir())


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'map.db'


@pytest.fixture
def killed(path):
    """Return a map whose owner ended when its places were in the log alone."""
    if not os.fork():
        module.MapWriter.settle = lambda _: None
        own(path, 9)
        os._exit(0)
    os.wait()
    assert beside(path) == ['', '-lock', '-shm', '-wal']
    assert path.with_name('map.db-wal').stat().st_size > 9 * cells(0).nbytes
    return path


def test_reading_waits_for_no_commit(path):
    owner, other = own(path, 5), MapReader(path)
    owner._writer._database.begin('EXCLUSIVE')
    assert is_right(owner.reference_map, 5) and is_right(other.reference_map(), 5)
    owner._writer._database.roll_back()
    owner.close()


def test_what_is_committed_is_in_the_file_alone_while_its_owner_lives(path, tmp_path):
    owner = own(path, 5)
    assert path.read_bytes()[MODES] == AHEAD
    assert path.with_name('map.db-wal').stat().st_size == 0
    shutil.copy(path, tmp_path / 'copy.db')
    assert is_right(open_map(tmp_path / 'copy.db'), 5)
    owner.close()


def test_a_map_that_is_closed_is_one_file_and_still_known(path):
    owner = own(path, 5)
    owner.close()
    assert beside(path) == [''] and path.read_bytes()[MODES] == JOURNAL
    assert is_right(owner.reference_map, 5)


def test_who_reads_before_meanwhile_and_after_sees_all_that_is_there(path):
    own(path, 3).close()
    before = MapReader(path)
    owner = own(path, 4)
    meanwhile = MapReader(path)
    assert is_right(before.reference_map(), 7) and is_right(meanwhile.reference_map(), 7)
    owner.close()
    assert path.with_name('map.db-wal').stat().st_size == 0
    next_owner = own(path, 2)
    for reader in (before, meanwhile):
        assert is_right(reader.reference_map(), 9)
    next_owner.close()
    del before, meanwhile, reader, owner, next_owner
    own(path).close()
    assert beside(path) == [''] and is_right(open_map(path), 9)


def test_a_log_that_a_crash_left_is_read_and_the_file_is_not_changed(killed):
    content = killed.read_bytes()
    assert is_right(open_map(killed), 9)
    assert killed.read_bytes() == content


def test_a_log_that_a_crash_left_is_read_where_nothing_may_be_written(killed):
    killed.with_name('map.db-shm').unlink()
    killed.with_name('map.db-shm').mkdir()  # now it cannot be shared
    content = killed.read_bytes()
    assert is_right(open_map(killed), 9)
    assert killed.read_bytes() == content


def test_the_next_owner_goes_on_with_a_log_that_a_crash_left(killed):
    own(killed, 2).close()
    assert beside(killed) == [''] and is_right(open_map(killed), 11)


def test_a_file_system_that_shares_no_memory_has_a_journal(path):
    path.with_name('map.db-shm').mkdir()
    owner = own(path, 5)
    assert path.read_bytes()[MODES] == JOURNAL
    grow(owner.reference_map, 4)
    owner.close()
    assert is_right(open_map(path), 9)


@pytest.mark.parametrize('end', ['-journal', '-wal'])
def test_a_pipe_with_the_name_of_a_journal_is_refused_at_once(path, end):
    own(path, 1).close()
    os.mkfifo(f'{path}{end}')
    for use in (open_map, own):
        with pytest.raises(MapError, match=f'{end}: is no file'):
            use(path)
