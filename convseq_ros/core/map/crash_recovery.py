# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Opening a map file, whatever a crash, a stranger or another program left beside it."""

from contextlib import suppress
import os
from pathlib import Path
import shutil
import sqlite3
import tempfile

from convseq_ros.core.map.database import DAMAGED, Database
from convseq_ros.core.map.format import PAGE_BYTES
from convseq_ros.core.map.wal_check import refuse_damaged_log
from convseq_ros.errors import MapError

_JOURNAL, _LOG = '-journal', '-wal'  # of SQLite, beside the file
# Of a reader who may not write beside the file, where what is shared of a log has its place.
_NOT_SHARED = sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY
_TRIES = 5  # to read what a crash left behind while another program mends it
# The end of a journal that names further files, which SQLite would delete.
_NAMES_OTHERS = bytes.fromhex('d9d505f920a163d7')
EMPTY = 'is empty, no map yet'


def open_to_read(path: Path) -> Database:
    """
    Return a map file that is not changed.

    If a crash left it with a journal, or it is not for this user to share in a log, a mended copy.
    """
    if path.is_dir():
        raise MapError(f'{path}: is a folder; name the map file in it')
    if not path.is_file():
        raise MapError(f'{path}: no such map; make one with `convseq build-map RECORDING {path}`')
    _refuse_irregular(path)
    for last in range(_TRIES, 0, -1):
        refuse_damaged_log(_beside(path, _LOG))
        database = Database(path, 'ro')
        try:
            pages = database.number('PRAGMA page_count')
            there = sum(_bytes(_beside(path, end)) for end in (_LOG, ''))
            if there < pages * database.number('PRAGMA page_size'):
                raise MapError(f'{path}: {DAMAGED.format("cut short")}')
            if not pages:
                raise MapError(f'{path}: {EMPTY}; make one with `convseq build-map RECORDING MAP`')
            return database
        except sqlite3.OperationalError as error:
            database.close()
            is_whole = not _beside(path, _JOURNAL).exists()
            if last == 1 or (is_whole and error.sqlite_errorcode & 0xFF not in _NOT_SHARED):
                raise
            if mended := _mended_copy(path):
                return mended
        except BaseException:
            database.close()
            raise
    raise AssertionError('the last try returns or raises')


def open_to_write(path: Path) -> Database:
    """Return a map file, mended if a crash left it with a journal, or a new one without pages."""
    if path.exists() and not path.is_file():
        raise MapError(f'{path}: is no file; name the map file')
    _refuse_irregular(path)
    _refuse_other_files(path)
    refuse_damaged_log(_beside(path, _LOG))
    database = Database(path, 'rwc')
    database.rows(f'PRAGMA page_size = {PAGE_BYTES}')
    try:
        database.journal()
    except sqlite3.OperationalError:  # of a log, where programs share no memory
        database.close()
        database = Database(path, 'rw')
        database.rows('PRAGMA locking_mode = EXCLUSIVE')
        database.journal()
        database.rows('PRAGMA locking_mode = NORMAL')
        database.number('PRAGMA page_count')  # from when on others may read
    # The folder is synced as well, so that a power cut does not bring a journal back to life.
    database.rows('PRAGMA synchronous = EXTRA')
    return database


def _beside(path: Path, end: str) -> Path:
    return path.with_name(path.name + end)


def _bytes(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def _refuse_irregular(path: Path) -> None:
    """Raise MapError for a pipe, say, that has the name of a journal: SQLite would wait for it."""
    for one in (_beside(path, _JOURNAL), _beside(path, _LOG)):
        if one.exists() and not one.is_file():
            raise MapError(f'{one}: is no file; delete it')


def _mended_copy(path: Path) -> Database | None:
    """Return a copy without what was not committed; None if the file changed meanwhile."""
    _refuse_other_files(path)

    def state() -> list[tuple[str, int, int, int]]:
        found = [(end, _beside(path, end)) for end in (_LOG, _JOURNAL, '')]
        looked = [(end, one.stat()) for end, one in found if one.exists()]
        return [(end, one.st_ino, one.st_size, one.st_mtime_ns) for end, one in looked]

    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, 'map')
        try:
            before = state()
            for end, *_ in before:
                shutil.copyfile(_beside(path, end), _beside(copy, end))
            if state() != before:
                return None
        except FileNotFoundError:
            return None
        database = Database(copy, 'rw')
        try:
            database.journal()
            if not database.number('PRAGMA page_count'):
                raise MapError(f'{path}: {EMPTY}; make one with `convseq build-map RECORDING MAP`')
        except BaseException:
            database.close()
            raise
    return database


def _refuse_other_files(path: Path) -> None:
    own = _beside(path, _JOURNAL)
    with suppress(FileNotFoundError), own.open('rb') as journal:
        journal.seek(max(0, journal.seek(0, os.SEEK_END) - len(_NAMES_OTHERS)))
        if journal.read() == _NAMES_OTHERS:
            raise MapError(f'{own}: names other files, and no map does; delete it')
