# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map's SQLite file: who may write it; nothing of it is believed before it was checked."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import fcntl
import glob
import os
from pathlib import Path
import sqlite3
import stat
import time
from typing import Any, Self

from convseq_ros.core.map.format import APPLICATION_ID, FORMAT_VERSION, row_crc, SCHEMA, TABLES
from convseq_ros.errors import MapError
from convseq_ros.regular_file import PART

Rows = list[tuple[Any, ...]]

BESIDE = '-journal', '-wal', '-shm'  # SQLite's files
_SAFELY = (  # https://sqlite.org/security.html
    'PRAGMA trusted_schema = OFF',
    'PRAGMA cell_size_check = ON',
    'PRAGMA mmap_size = 0',
)
_LONGEST_BYTES = 1 << 26  # of a row or a value; the largest image of a camera is some 20 MB
_LIMIT_S = 2.0  # of the processor's time, for a statement; 1,024 rows take some 10 ms
_PATIENCE_S = 10.0  # for who holds the file; a slow card may take seconds to sync
_STEPS = 20_000  # of SQLite's machine, between two looks at the clock: some .4 ms
_MOST_SAID = 200  # characters of an error
DAMAGED = 'damaged map ({}); build it again'
_READ = 'cannot be read ({}); is the disk failing?'
_WENT_WRONG = {  # by result code of SQLite, extended or primary
    sqlite3.SQLITE_NOTADB: 'not a convseq map',
    sqlite3.SQLITE_BUSY: 'another program holds it ({}); try again',
    sqlite3.SQLITE_CONSTRAINT: 'another program added to this map ({}); what comes now is not '
    'kept: let only one do so, and start again',
    sqlite3.SQLITE_READONLY: 'is read-only ({}); make it and its folder writable',
    sqlite3.SQLITE_CANTOPEN: 'cannot be opened ({}); is it in a folder that exists, and allowed?',
    sqlite3.SQLITE_FULL: 'cannot write ({}); make room on the disk',
    sqlite3.SQLITE_IOERR: 'cannot write ({}); is the disk full, or failing?',
    sqlite3.SQLITE_IOERR_READ: _READ,
    sqlite3.SQLITE_IOERR_SHORT_READ: _READ,
    sqlite3.SQLITE_INTERRUPT: DAMAGED.format(f'a statement took more than {_LIMIT_S:g} s'),
}


class Database:
    """
    A connection to a map file: `mode` is ro, rw or, to make it if there is none, rwc.

    What a stranger put into the file is not executed, no statement takes for ever, no value takes
    more memory than an image may. Use it within `explained`.
    """

    def __init__(self, path: Path, mode: str) -> None:
        address = f'{path.absolute().as_uri()}?mode={mode}'
        self._database = sqlite3.connect(
            address, _PATIENCE_S, isolation_level=None, check_same_thread=False, uri=True
        )
        self.close = self._database.close
        self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST_BYTES)
        for pragma in _SAFELY:
            self._database.execute(pragma)
        self._until_s = 0.0
        self._database.set_progress_handler(lambda: time.thread_time() > self._until_s, _STEPS)

    def rows(self, statement: str, values: tuple[object, ...] = ()) -> Rows:
        """Execute a statement; return what it yields."""
        self._until_s = time.thread_time() + _LIMIT_S
        return self._database.execute(statement, values).fetchall()

    def number(self, statement: str) -> int:
        """Return the one number that a statement yields."""
        return int(self.rows(statement)[0][0])

    def sound(self, table: str, condition: str = '', values: tuple[int, ...] = ()) -> Rows:
        """Return rows of a table; ValueError if one fails its checksum."""
        rows = self.rows(f'SELECT * FROM {table} {condition}', values)
        for row in rows:
            if row_crc(row[:-1]) != row[-1]:
                one = f'reference {row[0]}' if 'reference_index' in TABLES[table] else table
                raise ValueError(f'{one} fails its checksum')
        return rows

    def insert(self, table: str, row: tuple[object, ...], how: str = 'INSERT') -> None:
        """Write a row, and its checksum."""
        marks = ', '.join('?' * (len(row) + 1))
        self.rows(f'{how} INTO {table} VALUES ({marks})', (*row, row_crc(row)))

    @contextmanager
    def transaction(self, kind: str = 'DEFERRED') -> Iterator[None]:
        """Do all of what follows, or nothing; see what the file held at one moment."""
        self.begin(kind)
        with self._database:
            yield

    def begin(self, kind: str = 'IMMEDIATE') -> None:
        """Begin a transaction, unless one is begun: by default one that writes."""
        if not self._database.in_transaction:
            self.rows(f'BEGIN {kind}')

    def commit(self) -> None:
        """End the transaction, if one is begun: what it wrote is safe."""
        self._database.commit()

    def roll_back(self) -> None:
        """End the transaction, if one is begun: nothing was written."""
        with suppress(sqlite3.Error):
            self._database.rollback()

    def write_ahead(self) -> None:
        """
        Have commits go to a log beside the file, so that no reader waits; not while another reads.

        sqlite3.Error if that fails, as where programs share no memory; then close this.
        """
        self._journal_mode('WAL')
        self.begin()
        self.roll_back()

    def journal(self) -> None:
        """Have commits go to the file, and all of the log; the log is gone if nobody reads."""
        if not self._journal_mode('DELETE'):
            self.settle()

    def settle(self) -> None:
        """Have the file hold what the log does, and the log nothing; later if readers are busy."""
        self.rows('PRAGMA wal_checkpoint(TRUNCATE)')

    def _journal_mode(self, mode: str) -> bool:
        """Return whether a mode was taken, which needs a moment without readers."""
        try:
            self.rows(f'PRAGMA journal_mode = {mode}')
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY:
                return False
            raise
        return True

    def make_tables(self) -> None:
        """Make a map without places, or without those that it has, in a transaction."""
        for table, statement in SCHEMA.items():
            self.rows(f'DROP TABLE IF EXISTS {table}')
            self.rows(statement)
        self.rows(f'PRAGMA application_id = {APPLICATION_ID}')
        self.rows(f'PRAGMA user_version = {FORMAT_VERSION}')

    def check(self, path: Path) -> None:
        """Raise MapError if this is no map of this format; ValueError if it holds other tables."""
        if self.number('PRAGMA application_id') != APPLICATION_ID:
            raise MapError(f'{path}: not a convseq map but another SQLite file')
        own = self.number('PRAGMA user_version')
        if own != FORMAT_VERSION:
            remedy = 'update convseq_ros' if own > FORMAT_VERSION else 'build the map again'
            raise MapError(
                f'{path}: map format {own}, this program reads {FORMAT_VERSION}; {remedy}'
            )
        found = self.rows('SELECT name, sql FROM sqlite_master')
        if sorted(found) != sorted(SCHEMA.items()):
            others = sorted({str(name) for name, _ in found} - SCHEMA.keys())
            raise ValueError(f'{others or "tables"} that no map has')


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Raise MapError, one line with the file's name, for whatever goes wrong with a map file."""
    try:
        yield
    except OSError as error:
        raise MapError(f'{path}: cannot be read ({error.strerror})') from error
    except MemoryError as error:
        what = 'a row that takes more memory than there is'
        raise MapError(f'{path}: {DAMAGED.format(what)}') from error
    except (sqlite3.Error, OverflowError, RecursionError, ValueError, TypeError) as error:
        code = getattr(error, 'sqlite_errorcode', 0)
        words = _WENT_WRONG.get(code) or _WENT_WRONG.get(code & 0xFF, DAMAGED)
        # A stranger's words may be long, and more than text to a terminal.
        text = ascii(' '.join(str(error).split())[:_MOST_SAID])[1:-1]
        raise MapError(f'{path}: {words.format(text)}') from error


class MapLock:
    """
    A lock on a map by its name, `<map>-lock` beside it; MapError if another owner holds it.

    The system releases it when the program ends, however it does; what a crash leaves of the file
    holds nobody up, and parts of maps are deleted. It is not a lock on the map itself: one that is
    closed would take SQLite's with it. Readers need none.
    """

    def __init__(self, path: Path) -> None:
        _refuse_read_only(path)
        target = path.resolve()
        self._path, is_ours = target.with_name(f'{target.name}-lock'), False
        while not is_ours:
            try:
                self._file = os.open(self._path, os.O_CREAT | os.O_NOFOLLOW, 0o666)
            except OSError as error:
                raise MapError(f'{path}: cannot be written ({error.strerror})') from None
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                is_ours = os.path.samestat(os.fstat(self._file), os.stat(self._path))
            except FileNotFoundError:  # its owner deleted it meanwhile
                pass
            except BlockingIOError:
                os.close(self._file)
                raise MapError(
                    f'{path}: another program adds to this map; end it, or name another map'
                ) from None
            if not is_ours:
                os.close(self._file)
        _delete_parts(target)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Let others write the map."""
        with suppress(OSError):
            self._path.unlink()
        os.close(self._file)


def _refuse_read_only(path: Path) -> None:
    """Say at the start what would else go wrong later; SQLite needs the folder for its journal."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise MapError(f'{path}: there is no folder {folder}; make it')
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise MapError(
            f'{path}: cannot be written; make it and its folder writable, or copy it elsewhere'
        )


def _delete_parts(target: Path) -> None:
    """
    Delete what programs left beside a map that were killed while they replaced it.

    None is made without the lock. What others may have made stays: only this user's closed folders
    are looked at, of such a name, with nothing but a map in them.
    """
    own = {target.name + end for end in ('', '-lock', *BESIDE)}
    made = f'{glob.escape(target.name)}.{8 * "[a-z0-9_]"}{PART}'  # by `tempfile`
    with suppress(OSError):
        for one in target.parent.glob(made):
            with suppress(OSError):
                about = one.lstat()
                is_closed = about.st_mode == stat.S_IFDIR | 0o700
                if is_closed and about.st_uid == os.geteuid() and own.issuperset(os.listdir(one)):
                    for name in os.listdir(one):
                        (one / name).unlink()
                    one.rmdir()
