# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A growing map is persisted in its file, by one owner at a time."""

import os
import shutil
import sqlite3
import threading
from unittest.mock import Mock

from convseq_ros.core.map import appender as module
from convseq_ros.core.map import crash_recovery, writer
from convseq_ros.core.map.appender import Appender
from convseq_ros.core.map.database import Database
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map.writer import save_map
from convseq_ros.errors import MapError
from programs import open_files, wait_for
import pytest

from bench.torture.maps import APART, cells, drawn, ENCODING, grow, holds

pytestmark = pytest.mark.once

MODES = slice(18, 20)  # of the file: how it is written and read
JOURNAL, AHEAD = b'\1\1', b'\2\2'


def own(path, **kwargs):
    return Appender(path, ENCODING, APART, **kwargs)


def grown(path, count=0):
    owner = own(path)
    grow(owner.reference_map, count)
    owner.flush()
    return owner


def is_right(of_map, count):
    right = [(of_map.packed(index) == cells(index)).all() for index in range(len(of_map))]
    return len(of_map) == count and all(right)


def beside(path):
    return sorted(one.name.removeprefix(path.name) for one in path.parent.iterdir())


def told(owner):
    """Return a condition: that the owner says what went wrong, by a MapError."""

    def found():
        try:
            owner.save()
        except MapError as error:
            found.text = str(error)
            return True
        return False

    return found


@pytest.fixture(autouse=True)
def hurried(monkeypatch):
    """Commit a hundred times as often."""
    monkeypatch.setattr(module, '_COMMIT_EVERY_S', 0.005)


def test_a_place_is_written_though_nothing_comes_after_it(path):
    owner = own(path)
    for count in (1, 2, 7):
        grow(owner.reference_map, count - len(owner.reference_map))
        owner.save()
        wait_for(lambda count=count: owner.committed == count)
        assert holds(path) == count
    owner.close()


def test_an_interruption_finds_no_lock_that_it_could_leave_behind(path, monkeypatch):
    owner = own(path)
    grow(owner.reference_map, 1)
    with monkeypatch.context() as patch:
        patch.setattr(threading.Condition, '__enter__', Mock(side_effect=RuntimeError))
        owner.save()
    owner.close()
    assert holds(path) == 1


def test_saved_pictures_leave_memory_and_can_still_be_read(path):
    owner = own(path)
    for _ in range(30):
        grow(owner.reference_map, 1)
        owner.flush()
        assert not owner.reference_map._in_memory
    assert is_right(owner.reference_map, 30)
    owner.close()
    assert is_right(owner.reference_map, 30)


def test_an_empty_file_is_made_into_a_map_unless_there_must_be_one(path):
    path.touch()
    with pytest.raises(MapError, match='is empty, no map yet'):
        own(path, append=True)
    own(path).close()
    assert holds(path) == 0


@pytest.mark.parametrize('what', ['folder', 'file'])
def test_a_read_only_map_or_folder_is_refused_at_the_start(path, what, monkeypatch):
    save_map(drawn(2), path)
    blocked = path if what == 'file' else path.parent
    monkeypatch.setattr(os, 'access', lambda one, _mode: os.fspath(one) != os.fspath(blocked))
    with pytest.raises(MapError, match=r'map.db: cannot be written; make it and its folder'):
        own(path)


def test_a_full_disk_is_reported_once_and_places_are_written_when_space_returns(path):
    owner = grown(path, 1)
    reference_map, database = owner.reference_map, owner._writer._database

    def resize_disk(pages):
        with owner._writing:  # of two threads in one connection, one may miss its error
            database.rows(f'PRAGMA max_page_count = {pages}')

    resize_disk(6)
    grow(reference_map, 400)
    full = told(owner)
    wait_for(full)
    assert 'map.db: cannot write' in full.text and 'make room on the disk' in full.text
    with pytest.raises(MapError, match='make room'):
        owner.flush()
    tries = owner._writer.copy = Mock(wraps=owner._writer.copy)
    wait_for(lambda: tries.call_count > 2)
    del owner._writer.copy  # a cycle would keep the file open
    owner.save()  # those fail without a word
    assert holds(path) == 1 and (reference_map.packed(40) == cells(40)).all()
    resize_disk(1_000_000)
    wait_for(lambda: owner.committed == 401)
    assert holds(path) == 401
    resize_disk(6)
    grow(reference_map, 400)
    with pytest.raises(MapError, match='make room'):
        owner.close()


def test_a_second_writer_is_refused_at_the_start_and_the_first_loses_nothing(path):
    save_map(drawn(3), path)
    assert not open_files(path)
    first, count = own(path), open_files(path)
    assert count
    for another in (lambda: own(path), lambda: save_map(drawn(1), path)):
        with pytest.raises(MapError, match=r'map.db: another program adds to this map; end it'):
            another()
    assert open_files(path) == count
    assert holds(path) == 3
    grow(first.reference_map, 1)
    first.close()
    grown(path, 2).close()
    assert holds(path) == 6


def test_an_owner_whose_lock_was_deleted_raises_an_error_and_writes_nothing(path):
    first = own(path)
    path.with_name('map.db-lock').unlink()
    grown(path, 2).close()
    grow(first.reference_map, 3)
    with pytest.raises(MapError, match=r'another program added to this map .* start again'):
        first.flush()
    with pytest.raises(MapError):
        first.close()
    assert holds(path) == 2


def test_a_file_that_was_replaced_is_reported_and_left_alone(path, tmp_path):
    owner, other = grown(path, 1), tmp_path / 'other.db'
    path.rename(tmp_path / 'away.db')
    save_map(drawn(5), other)
    other.rename(path)
    before = path.read_bytes()
    grow(owner.reference_map, 1)
    moved = told(owner)
    wait_for(moved)
    assert 'map.db: was moved or replaced' in moved.text
    assert path.read_bytes() == before
    (tmp_path / 'away.db').rename(path)
    wait_for(lambda: owner.committed == 2)
    owner.close()
    assert holds(path) == 2


@pytest.mark.parametrize(
    ('harm', 'told'),
    [
        (lambda was, _: was[: len(was) // 2], ''),
        (lambda *_: b'', ''),
        (lambda was, _: bytes(len(was)), ''),
        (lambda _, other: other, '.*it is another map'),
    ],
    ids=['cut short', 'empty', 'overwritten', 'another map'],
)
def test_a_file_that_others_cut_short_or_overwrite_is_given_up(path, tmp_path, harm, told):
    owner, other = grown(path, 5), tmp_path / 'other.db'
    save_map(drawn(400), other)
    harmed = harm(path.read_bytes(), other.read_bytes())
    path.write_bytes(harmed)
    grow(owner.reference_map, 1)
    for tell in (owner.flush, owner.save):
        with pytest.raises(MapError, match=f'was cut short or overwritten {told}') as caught:
            tell()
        assert '\n' not in str(caught.value) and 'restore the file' in str(caught.value)
    owner.save()
    with pytest.raises(MapError, match=r'map\.db: '):
        owner.reference_map.pictures(range(5))
    with pytest.raises(MapError, match='was cut short or overwritten'):
        owner.close()
    assert path.read_bytes() == harmed


@pytest.fixture
def killed(path):
    """Return a map whose owner ended when its places were in the log alone."""
    if not os.fork():
        writer.MapWriter.checkpoint = lambda _: None
        grown(path, 9)
        os._exit(0)
    os.wait()
    assert beside(path) == ['', '-lock', '-shm', '-wal']
    assert path.with_name('map.db-wal').stat().st_size > 9 * cells(0).nbytes
    return path


def test_reading_waits_for_no_commit(path):
    owner, other = grown(path, 5), MapReader(path)
    owner._writer._database.begin('EXCLUSIVE')
    assert is_right(owner.reference_map, 5) and is_right(other.reference_map(), 5)
    owner._writer._database.roll_back()
    owner.close()


def test_committed_places_are_in_the_file_itself_while_its_owner_lives(path, tmp_path):
    owner = grown(path, 5)
    assert path.read_bytes()[MODES] == AHEAD
    assert path.with_name('map.db-wal').stat().st_size == 0
    shutil.copy(path, tmp_path / 'copy.db')
    assert is_right(open_map(tmp_path / 'copy.db'), 5)
    owner.close()


def test_readers_see_all_committed_places_before_during_and_after_a_write(path):
    grown(path, 3).close()
    before = MapReader(path)
    owner = grown(path, 4)
    meanwhile = MapReader(path)
    assert is_right(before.reference_map(), 7) and is_right(meanwhile.reference_map(), 7)
    owner.close()
    assert path.with_name('map.db-wal').stat().st_size == 0
    next_owner = grown(path, 2)
    for reader in (before, meanwhile):
        assert is_right(reader.reference_map(), 9)
    next_owner.close()
    del before, meanwhile, reader, owner, next_owner
    grown(path).close()
    assert beside(path) == [''] and is_right(open_map(path), 9)
    assert path.read_bytes()[MODES] == JOURNAL


@pytest.mark.parametrize('is_shared', [True, False])
def test_a_log_that_a_crash_left_is_read_and_the_file_is_not_changed(killed, is_shared):
    if not is_shared:  # as where nothing may be written
        killed.with_name('map.db-shm').unlink()
        killed.with_name('map.db-shm').mkdir()
    content = killed.read_bytes()
    assert is_right(open_map(killed), 9)
    assert killed.read_bytes() == content


@pytest.mark.parametrize('error', [sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY_CANTINIT])
def test_a_log_without_shared_memory_is_read_from_a_copy(killed, monkeypatch, error):
    class Unshared(Database):
        def __init__(self, path, mode):
            super().__init__(path, mode)
            self.mode = mode

        def number(self, statement):
            if self.mode == 'ro':
                failed = sqlite3.OperationalError('not shared')
                failed.sqlite_errorcode = error
                raise failed
            return super().number(statement)

    monkeypatch.setattr(crash_recovery, 'Database', Unshared)
    assert is_right(open_map(killed), 9)


@pytest.mark.parametrize('is_shared', [True, False])
def test_the_next_owner_continues_a_log_that_a_crash_left(killed, is_shared):
    shared = killed.with_name('map.db-shm')
    if not is_shared:  # as where programs share no memory
        shared.unlink()
        shared.mkdir()
    owner = grown(killed, 2)
    assert is_right(open_map(killed), 11)
    owner.close()
    if not is_shared:
        shared.rmdir()
    assert beside(killed) == [''] and is_right(open_map(killed), 11)


def test_a_file_system_that_shares_no_memory_has_a_journal(path):
    path.with_name('map.db-shm').mkdir()
    owner = grown(path, 5)
    assert path.read_bytes()[MODES] == JOURNAL
    grow(owner.reference_map, 4)
    owner.close()
    assert is_right(open_map(path), 9)


@pytest.mark.parametrize('end', ['-journal', '-wal'])
def test_a_pipe_with_the_name_of_a_journal_is_refused_at_once(path, end):
    grown(path, 1).close()
    os.mkfifo(f'{path}{end}')
    for use in (open_map, grown):
        with pytest.raises(MapError, match=f'{end}: is not a file'):
            use(path)
