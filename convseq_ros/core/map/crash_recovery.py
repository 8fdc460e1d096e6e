# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Opening a map file, also if a crash or another program left a journal or a log beside it.

SQLite reads a log up to the first page that fails its checksum and ignores the rest, because a
power cut may leave half a commit. It is damage if further commits follow, because a commit is only
made after the one before is safe. The log's format is that of
https://sqlite.org/fileformat2.html, section 4.
"""

from contextlib import suppress
from functools import cache
import os
from pathlib import Path
import shutil
import sqlite3
import struct
import tempfile
from typing import BinaryIO

from convseq_ros.core.map.database import DAMAGED, Database
from convseq_ros.core.map.format import PAGE_BYTES
from convseq_ros.errors import MapError
import numpy as np
import numpy.typing as npt

_JOURNAL, _LOG = '-journal', '-wal'  # of SQLite, beside the file
# Errors of a reader that may not write to the folder, where SQLite keeps a log's shared memory.
_NOT_SHARED = sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY
_TRIES = 5  # to read a file after a crash, while another program may repair it
# The end of a journal that names other files, which SQLite would delete.
_NAMES_OTHERS = bytes.fromhex('d9d505f920a163d7')
EMPTY = 'is empty, no map yet'
_HEAD, _FRAME = struct.Struct('>8I'), struct.Struct('>6I')
_MAGIC = 0x377F0682  # its last bit is the byte order of the checksums
_SUMMED_OF_HEAD = 24  # bytes of the log's header that its checksum covers
_SUMMED = 8  # bytes of a frame's header that its checksum covers, before the page
_PAGE_BYTES = frozenset(1 << power for power in range(9, 17))  # page sizes of SQLite
_MAX_FRAMES = 8192  # searched for commits; a commit of at most 500 places takes some 1,500

Words = npt.NDArray[np.uint32]


def open_to_read(path: Path) -> Database:
    """Return a map file opened for reading; a repaired copy if it cannot be read as it is."""
    if path.is_dir():
        raise MapError(f'{path}: is a folder; name the map file in it')
    if not path.is_file():
        raise MapError(f'{path}: no such map; make one with `convseq build-map RECORDING {path}`')
    for last in range(_TRIES, 0, -1):
        _refuse_damaged(path)
        database = Database(path, 'ro')
        try:
            pages = database.number('PRAGMA page_count')
            size = sum(_bytes(_beside(path, end)) for end in (_LOG, ''))
            if size < pages * database.number('PRAGMA page_size'):
                raise MapError(f'{path}: {DAMAGED.format("cut short")}')
            if not pages:
                raise MapError(f'{path}: {EMPTY}; make one with `convseq build-map RECORDING MAP`')
            return database
        except sqlite3.OperationalError as error:
            database.close()
            is_clean = not _beside(path, _JOURNAL).exists()
            if last == 1 or (is_clean and error.sqlite_errorcode & 0xFF not in _NOT_SHARED):
                raise
            if copy := _repaired_copy(path):
                return copy
        except BaseException:
            database.close()
            raise
    raise AssertionError('the last try returns or raises')


def open_to_write(path: Path) -> Database:
    """Return a map file opened for writing: repaired after a crash, or new and without pages."""
    if path.exists() and not path.is_file():
        raise MapError(f'{path}: is not a file; name the map file')
    _refuse_damaged(path)
    database = Database(path, 'rwc')
    database.rows(f'PRAGMA page_size = {PAGE_BYTES}')
    try:
        database.journal()
    except sqlite3.OperationalError:  # there is a log, and no shared memory to read it with
        database.close()
        database = Database(path, 'rw')
        database.rows('PRAGMA locking_mode = EXCLUSIVE')
        database.journal()
        database.rows('PRAGMA locking_mode = NORMAL')
        database.number('PRAGMA page_count')  # releases the exclusive lock
    # EXTRA also syncs the folder, so that a deleted journal stays deleted after a power cut.
    database.rows('PRAGMA synchronous = EXTRA')
    return database


def _beside(path: Path, end: str) -> Path:
    return path.with_name(path.name + end)


def _bytes(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def _repaired_copy(path: Path) -> Database | None:
    """Return a copy without uncommitted changes; None if the file changed meanwhile."""

    def state() -> list[tuple[str, int, int, int]]:
        files = [(end, _beside(path, end)) for end in (_LOG, _JOURNAL, '')]
        stats = [(end, file.stat()) for end, file in files if file.exists()]
        return [(end, stat.st_ino, stat.st_size, stat.st_mtime_ns) for end, stat in stats]

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


def _refuse_damaged(path: Path) -> None:
    """Raise MapError if a journal is harmful, or SQLite would ignore commits of a damaged log."""
    journal, log = _beside(path, _JOURNAL), _beside(path, _LOG)
    for file_path in (journal, log):
        if file_path.exists() and not file_path.is_file():  # SQLite would wait for a pipe
            raise MapError(f'{file_path}: is not a file; delete it')
    with suppress(OSError), journal.open('rb') as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - len(_NAMES_OTHERS)))
        if file.read() == _NAMES_OTHERS:
            raise MapError(f'{journal}: names other files, and no map does; delete it')
    try:
        with log.open('rb') as file:
            is_large = os.fstat(file.fileno()).st_size > _HEAD.size + PAGE_BYTES
            at = _damaged_at(file) if is_large else -1
    except OSError:
        return  # SQLite reports the error
    if at >= 0:
        raise MapError(
            f'{log}: damaged at byte {at}; it holds the newest places of the map: restore it, '
            'or delete it, and the map opens without them'
        )


def _damaged_at(log: BinaryIO) -> int:
    """Return the byte where damage begins; -1 if no commit is damaged."""
    head = log.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return -1  # since its size was asked, a program has emptied it: the map has all of it
    magic, _, page_bytes, _, *salts, first, second = _HEAD.unpack(head)
    sums, order = np.array((first, second), np.uint32), '<>'[magic & 1]
    is_head = magic & ~1 == _MAGIC and page_bytes in _PAGE_BYTES
    initial = np.zeros(2, np.uint32)
    if not is_head or (_checksum(head[:_SUMMED_OF_HEAD], order, initial) != sums).any():
        return 0  # the header is safe on disk before any frame is written
    at, size = _HEAD.size, _FRAME.size + page_bytes
    while len(frame := log.read(size)) == size:
        _, _, *frame_salts, first, second = _FRAME.unpack_from(frame)
        content = frame[:_SUMMED] + frame[_FRAME.size :]
        computed, stored = _checksum(content, order, sums), np.array((first, second), np.uint32)
        if frame_salts != salts or (computed != stored).any():
            return at if _commits(log, at, size, salts) > 1 else -1
        sums, at = computed, at + size
    return -1


def _commits(log: BinaryIO, at: int, size: int, salts: list[int]) -> int:
    """Return how many commits of a log end at a byte or later; counts to 2 at most."""
    count = 0
    for number in range(_MAX_FRAMES):
        log.seek(at + number * size)
        if len(head := log.read(_FRAME.size)) < _FRAME.size or count > 1:
            break
        _, pages, *frame_salts, _, _ = _FRAME.unpack(head)
        count += bool(pages) and frame_salts == salts
    return count


def _checksum(content: bytes, order: str, before: Words) -> Words:
    """Return the checksum (2,) of bytes, which continues the one before."""
    words = np.frombuffer(content, f'{order}u4').astype(np.uint32)
    words[:1] += before[:1]
    words = np.concatenate([before[1:], words])
    return np.asarray(words @ _weights(len(words)))


@cache
def _weights(count: int) -> Words:
    """Return the weights (count, 2) of words in both sums of a checksum: Fibonacci numbers."""
    # For each pair of words x, y: first += x + second; second += y + first.
    numbers = [0, 1]
    while len(numbers) <= count:
        numbers.append(sum(numbers[-2:]) % 2**32)
    backwards = np.array(numbers[::-1], np.uint32)
    return np.stack([backwards[1:], backwards[:-1]], axis=1)
