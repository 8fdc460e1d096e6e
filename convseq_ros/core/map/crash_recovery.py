# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Opening a map file, whatever a crash, a stranger or another program left beside it.

SQLite reads a log up to the first page that fails its checksum, and passes over the rest without
a word: so it must, for a power cut may leave half a commit. What is damaged later is told apart
here: one flipped bit explains the checksum, or further commits follow, and each is made after the
one before is safe. The log's format is that of https://sqlite.org/fileformat2.html, section 4.
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
# Of a reader who may not write beside the file, where what is shared of a log has its place.
_NOT_SHARED = sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY
_TRIES = 5  # to read what a crash left behind while another program mends it
# The end of a journal that names further files, which SQLite would delete.
_NAMES_OTHERS = bytes.fromhex('d9d505f920a163d7')
EMPTY = 'is empty, no map yet'
_HEAD, _FRAME = struct.Struct('>8I'), struct.Struct('>6I')
_MAGIC = 0x377F0682  # the last bit tells the order of the bytes that are summed
_SUMMED_OF_HEAD = 24  # bytes
_SUMMED = 8  # bytes of a frame's head that are summed, before its page
_PAGE_BYTES = frozenset(1 << power for power in range(9, 17))  # that SQLite has
_LOOKED_AT = 8192  # frames; 500 places, which are the most in a commit, take some 1,500

Words = npt.NDArray[np.uint32]


def open_to_read(path: Path) -> Database:
    """Return a map file that is not changed: a mended copy if it must be mended to be read."""
    if path.is_dir():
        raise MapError(f'{path}: is a folder; name the map file in it')
    if not path.is_file():
        raise MapError(f'{path}: no such map; make one with `convseq build-map RECORDING {path}`')
    for last in range(_TRIES, 0, -1):
        _refuse_damaged(path)
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
    _refuse_damaged(path)
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


def _mended_copy(path: Path) -> Database | None:
    """Return a copy without what was not committed; None if the file changed meanwhile."""

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


def _refuse_damaged(path: Path) -> None:
    """Raise MapError if SQLite would do harm with a journal, or pass over what is committed."""
    journal, log = _beside(path, _JOURNAL), _beside(path, _LOG)
    for one in (journal, log):
        if one.exists() and not one.is_file():  # SQLite would wait for a pipe, say
            raise MapError(f'{one}: is no file; delete it')
    with suppress(OSError), journal.open('rb') as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - len(_NAMES_OTHERS)))
        if file.read() == _NAMES_OTHERS:
            raise MapError(f'{journal}: names other files, and no map does; delete it')
    try:
        with log.open('rb') as file:
            is_large = os.fstat(file.fileno()).st_size > _HEAD.size + PAGE_BYTES
            at = _damaged_at(file) if is_large else -1
    except OSError:
        return  # SQLite says what is wrong
    if at >= 0:
        raise MapError(
            f'{log}: damaged at byte {at}; it holds what was added to the map last: restore it, '
            'or delete it to go on without'
        )


def _damaged_at(log: BinaryIO) -> int:
    """Return where damage begins; -1 if there is none, or nothing that was safe."""
    head = log.read(_HEAD.size)
    magic, _, page_bytes, _, *salts, first, second = _HEAD.unpack(head)
    sums, order = np.array((first, second), np.uint32), '<>'[magic & 1]
    is_head = magic & ~1 == _MAGIC and page_bytes in _PAGE_BYTES
    nothing = np.zeros(2, np.uint32)
    if not is_head or (_sums(head[:_SUMMED_OF_HEAD], order, nothing) != sums).any():
        return 0  # it is safe before anything follows it
    at, size = _HEAD.size, _FRAME.size + page_bytes
    while len(frame := log.read(size)) == size:
        _, _, *own, first, second = _FRAME.unpack_from(frame)
        content = frame[:_SUMMED] + frame[_FRAME.size :]
        found, stored = _sums(content, order, sums), np.array((first, second), np.uint32)
        flipped = sum((a ^ b).bit_count() for a, b in zip(own, salts, strict=True))
        is_right = bool((found == stored).all())
        if flipped or not is_right:
            is_flip = flipped == 1 and is_right
            is_flip |= not flipped and _is_one_bit(content, order, sums, stored)
            return at if is_flip or _commits(log, at, size, salts) > 1 else -1
        sums, at = found, at + size
    return -1


def _commits(log: BinaryIO, at: int, size: int, salts: list[int]) -> int:
    """Return how many commits of a log end there or later; not all, if they are many."""
    found = 0
    for number in range(_LOOKED_AT):
        log.seek(at + number * size)
        if len(head := log.read(_FRAME.size)) < _FRAME.size or found > 1:
            break
        _, pages, *own, _, _ = _FRAME.unpack(head)
        found += bool(pages) and own == salts
    return found


def _sums(content: bytes, order: str, before: Words) -> Words:
    """Return both sums (2,) of some bytes, going on from those before."""
    words = np.frombuffer(content, f'{order}u4').astype(np.uint32)
    words[:1] += before[:1]
    words = np.concatenate([before[1:], words])
    return np.asarray(words @ _weights(len(words)))


def _is_one_bit(content: bytes, order: str, before: Words, stored: Words) -> bool:
    """Tell whether one flipped bit, of what is summed or of the sums, makes them differ."""
    found = _sums(content, order, before)
    if sum(int(one).bit_count() for one in found ^ stored) == 1:
        return True
    bits = _weights(len(content) // 4)[..., None] << np.arange(32, dtype=np.uint32)
    return any(
        (bits == off[:, None]).all(axis=1).any() for off in (found - stored, stored - found)
    )


@cache
def _weights(count: int) -> Words:
    """Return what each of some words adds to both sums, (words, 2): numbers of Fibonacci."""
    # Of two words x, y: first += x + second; second += y + first.
    numbers = [0, 1]
    while len(numbers) <= count:
        numbers.append(sum(numbers[-2:]) % 2**32)
    backwards = np.array(numbers[::-1], np.uint32)
    return np.stack([backwards[1:], backwards[:-1]], axis=1)
