# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map's SQLite file, read with checks because its content is untrusted."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
import sqlite3
import time
from typing import Any

from convseq_ros.core.map.format import APPLICATION_ID, FORMAT_VERSION, row_crc, SCHEMA, TABLES
from convseq_ros.errors import MapError

Rows = list[tuple[Any, ...]]

BESIDE = '-journal', '-wal', '-shm'  # SQLite's files
_SAFELY = (  # https://sqlite.org/security.html
    'PRAGMA trusted_schema = OFF',
    'PRAGMA cell_size_check = ON',
    'PRAGMA mmap_size = 0',
)
_LONGEST_BYTES = 1 << 26  # of a row or a value; the largest image of a camera is some 20 MB
_LIMIT_S = 2.0  # processor time of a statement; 1,024 rows take some 10 ms
_TIMEOUT_S = 10.0  # to wait for another connection; a slow card may take seconds to sync
_STEPS = 20_000  # of SQLite's virtual machine between two checks of the time: some 0.4 ms
_MAX_CHARACTERS = 200  # of an error message of SQLite
DAMAGED = 'damaged map ({}); build it again'
_READ = 'cannot be read ({}); is the disk failing?'
_MESSAGES = {  # by result code of SQLite, extended or primary
    sqlite3.SQLITE_NOTADB: 'not a convseq map',
    sqlite3.SQLITE_BUSY: 'another program holds it ({}); try again',
    sqlite3.SQLITE_CONSTRAINT: 'another program added to this map ({}); new places '
    'are not kept: let only one program add to it, and start again',
    sqlite3.SQLITE_READONLY: 'is read-only ({}); make it and its folder writable',
    sqlite3.SQLITE_CANTOPEN: 'cannot be opened ({}); does its folder exist, and may you read it?',
    sqlite3.SQLITE_FULL: 'cannot write ({}); make room on the disk',
    sqlite3.SQLITE_IOERR: 'cannot write ({}); is the disk full, or failing?',
    sqlite3.SQLITE_IOERR_READ: _READ,
    sqlite3.SQLITE_IOERR_SHORT_READ: _READ,
    sqlite3.SQLITE_INTERRUPT: DAMAGED.format(f'a statement took more than {_LIMIT_S:g} s'),
}


class Database:
    """
    A connection to a map file; `mode` is ro, rw or rwc, which makes the file if it is missing.

    Code in the file's schema is not executed. The time of a statement and the size of a value are
    limited. Use it within `as_map_error`.
    """

    def __init__(self, path: Path, mode: str) -> None:
        address = f'{path.absolute().as_uri()}?mode={mode}'
        self._database = sqlite3.connect(
            address, _TIMEOUT_S, isolation_level=None, check_same_thread=False, uri=True
        )
        self.close = self._database.close
        self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST_BYTES)
        for pragma in _SAFELY:
            self._database.execute(pragma)
        self._until_s = 0.0
        self._database.set_progress_handler(lambda: time.thread_time() > self._until_s, _STEPS)

    def rows(self, statement: str, values: tuple[object, ...] = ()) -> Rows:
        """Execute a statement; return its rows."""
        self._until_s = time.thread_time() + _LIMIT_S
        return self._database.execute(statement, values).fetchall()

    def number(self, statement: str) -> int:
        """Execute a statement; return its result, a single number."""
        return int(self.rows(statement)[0][0])

    def checked(self, table: str, condition: str = '', values: tuple[int, ...] = ()) -> Rows:
        """Return rows of a table; ValueError if one fails its checksum."""
        rows = self.rows(f'SELECT * FROM {table} {condition}', values)
        for row in rows:
            if row_crc(row[:-1]) != row[-1]:
                name = f'reference {row[0]}' if 'reference_index' in TABLES[table] else table
                raise ValueError(f'{name} fails its checksum')
        return rows

    def insert(self, table: str, row: tuple[object, ...], how: str = 'INSERT') -> None:
        """Write a row with its checksum."""
        marks = ', '.join('?' * (len(row) + 1))
        self.rows(f'{how} INTO {table} VALUES ({marks})', (*row, row_crc(row)))

    @contextmanager
    def transaction(self, kind: str = 'DEFERRED') -> Iterator[None]:
        """Run a block as one transaction: it commits all or nothing, and reads one snapshot."""
        self.begin(kind)
        with self._database:
            yield

    def begin(self, kind: str = 'IMMEDIATE') -> None:
        """Begin a transaction unless one is open; by default one that may write."""
        if not self._database.in_transaction:
            self.rows(f'BEGIN {kind}')

    def commit(self) -> None:
        """Commit the transaction, if one is open: its changes are safe on disk."""
        self._database.commit()

    def roll_back(self) -> None:
        """Roll back the transaction, if one is open: none of its changes is kept."""
        with suppress(sqlite3.Error):
            self._database.rollback()

    def write_ahead(self) -> None:
        """
        Write commits to a log beside the file, so that readers need not wait, if nobody reads now.

        sqlite3.Error if a log is impossible, as where programs share no memory; then close this.
        """
        self._journal_mode('WAL')
        self.begin()
        self.roll_back()

    def journal(self) -> None:
        """Write commits to the file again, and move the log into it; readers may delay that."""
        if not self._journal_mode('DELETE'):
            self.checkpoint()

    def checkpoint(self) -> None:
        """Move the log's content into the file and empty the log, unless readers are busy."""
        self.rows('PRAGMA wal_checkpoint(TRUNCATE)')

    def _journal_mode(self, mode: str) -> bool:
        """Set a journal mode; return False if readers prevent it."""
        try:
            self.rows(f'PRAGMA journal_mode = {mode}')
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY:
                return False
            raise
        return True

    def make_tables(self) -> None:
        """Make the tables of a map without places, replacing all that exist."""
        for table, statement in SCHEMA.items():
            self.rows(f'DROP TABLE IF EXISTS {table}')
            self.rows(statement)
        self.rows(f'PRAGMA application_id = {APPLICATION_ID}')
        self.rows(f'PRAGMA user_version = {FORMAT_VERSION}')

    def check(self, path: Path) -> None:
        """Raise MapError if this is not a map of this format, ValueError if tables differ."""
        if self.number('PRAGMA application_id') != APPLICATION_ID:
            raise MapError(f'{path}: not a convseq map but another SQLite file')
        version = self.number('PRAGMA user_version')
        if version != FORMAT_VERSION:
            remedy = 'update convseq_ros' if version > FORMAT_VERSION else 'build the map again'
            raise MapError(
                f'{path}: map format {version}, this program reads {FORMAT_VERSION}; {remedy}'
            )
        tables = self.rows('SELECT name, sql FROM sqlite_master')
        if sorted(tables) != sorted(SCHEMA.items()):
            others = sorted({str(name) for name, _ in tables} - SCHEMA.keys())
            raise ValueError(f'unknown tables {others}' if others else 'tables with other columns')


@contextmanager
def as_map_error(path: Path) -> Iterator[None]:
    """Turn errors of a map file into a MapError: one line with the file's name and a remedy."""
    try:
        yield
    except OSError as error:
        raise MapError(f'{path}: cannot be read ({error.strerror})') from error
    except MemoryError as error:
        cause = 'a row that takes more memory than there is'
        raise MapError(f'{path}: {DAMAGED.format(cause)}') from error
    except (sqlite3.Error, OverflowError, RecursionError, ValueError, TypeError) as error:
        code = getattr(error, 'sqlite_errorcode', 0)
        message = _MESSAGES.get(code) or _MESSAGES.get(code & 0xFF, DAMAGED)
        # SQLite quotes the untrusted file: the text may be long and hold control characters.
        text = ascii(' '.join(str(error).split())[:_MAX_CHARACTERS])[1:-1]
        raise MapError(f'{path}: {message.format(text)}') from error


def is_damage(error: MapError) -> bool:
    """Return whether SQLite found that the file is no map any more, or is damaged."""
    code = getattr(error.__cause__, 'sqlite_errorcode', 0)
    return code & 0xFF in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
