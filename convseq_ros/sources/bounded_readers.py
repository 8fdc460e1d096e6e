# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The readers of rosbags, with bounds on what a file can make them do.

They know nothing of message definitions in the file: of these, rosbags would make and run Python.
"""

from collections.abc import Iterable
import functools
from pathlib import Path
import re
import sqlite3
import struct
from typing import Any

from convseq_ros.errors import SourceError
from convseq_ros.reading_config import AS_YAML, ReadingConfig
from convseq_ros.regular_file import read_bytes, refuse_irregular
from convseq_ros.sources.inflate import end_of_records, inflate, inflated_size, RecordingLimits

_SQLITE_HEAD = struct.Struct('>16sH10xI')  # magic, bytes in a page (1 = 65536), pages
_BAG_MAGIC = b'#ROSBAG V2.0\n'
_SQLITE_MAGIC = b'SQLite format 3\0'
# A row takes 4 bytes of its file and some 20 steps of SQLite's machine to be counted.
_STEPS_AT_ONCE, _STEPS_FREE, _STEPS_A_BYTE = 100_000, 10_000_000, 10
_TABLES = ('messages', 'topics', 'schema', 'metadata', 'message_definitions')
_ALIAS = re.compile(rb'(?m)(?:^|[\s\[{,])\*\w')


def open_bounded(path: Path, limits: RecordingLimits) -> Any:
    """
    Return the reader of rosbags for a .mcap, .db3 or .bag file, or a folder with metadata.yaml.

    It is not yet open. The limits hold for it, and for those that are open. SourceError if it
    declares what no recording needs.
    """
    _bound_chunks(limits)
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    for file in files:
        refuse_irregular(file)
        if file.suffix.lower() == '.db3':
            _check_database(file)
        elif file.suffix.lower() == '.bag':
            _check_magic(file, _BAG_MAGIC)
        elif file.name == 'metadata.yaml':
            _check_metadata(file, limits.reading)
        elif file.suffix.lower() == '.zstd':
            size = file.stat().st_size
            most = max(limits.harmless_bytes, limits.ratio * size)
            limits.refuse_bomb(file, inflated_size(file, most), size)
    if path.suffix.lower() == '.bag':
        return _bounded_bag()(path, limits)
    from rosbags.rosbag2 import Reader

    return Reader(path)


def check_chunks(path: Path, reader: Any, limits: RecordingLimits) -> None:
    """
    Refuse an index of an mcap file that lists a chunk twice, or more than fits into memory.

    The reader of rosbags is open. SourceError, which names the path.
    """
    storages = getattr(reader.storage, 'storages', [reader.storage])
    for storage in storages:
        chunks = getattr(storage, 'chunks', [])
        size = storage.path.stat().st_size
        if sum(chunk.chunk_length for chunk in chunks) > size:
            raise SourceError(f'{path}: its index lists more than its {size} bytes')
        limits.refuse_bomb(path, sum(chunk.uncompressed_size for chunk in chunks), size)
        half_mb = _most_at_once(chunks) / 2 / 1e6
        what = f'{path}: half of {2 * half_mb:.0f} MB, whose chunks are of the same time,'
        limits.reading.refuse_above('max_file_mb', half_mb, what)


def _most_at_once(chunks: Iterable[Any]) -> int:
    """Return how many bytes of chunks overlap in time at most."""
    changes = [(chunk.message_start_time, 1, chunk.uncompressed_size) for chunk in chunks]
    changes += [(chunk.message_end_time, 2, -chunk.uncompressed_size) for chunk in chunks]
    most = now = 0
    for _, _, change in sorted(changes):
        now += change
        most = max(most, now)
    return most


def _bound_chunks(limits: RecordingLimits) -> None:
    """Have rosbags inflate no more than a chunk declares; alone, it looks afterwards."""
    from rosbags.rosbag2 import storage_mcap

    def bounded(compression: str, data: bytes, size: int) -> bytes:
        size_mb = size / 1e6
        limits.reading.refuse_above('max_file_mb', size_mb, f'a chunk of {size_mb:.4g} MB')
        content = inflate(data, compression, size)
        if end_of_records(content, len(data)) != len(content):
            raise SourceError('a chunk holds something else than records')
        return content

    for compression in ('zstd', 'lz4'):
        storage_mcap.DECOMPRESSORS[compression] = functools.partial(bounded, compression)


@functools.cache
def _bounded_bag() -> type:
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import decompressors

    names = {function: name for name, function in decompressors.items()}

    class BoundedBag(Reader):
        """A .bag whose index is read once, and whose chunks are bounded."""

        _indexed_bytes = _inflated_bytes = 0

        def __init__(self, path: Path, limits: RecordingLimits) -> None:
            super().__init__(path)
            self._limits = limits

        def read_index_data(self, pos: int, indexes: Any) -> None:
            """Read what a chunk's index says; ValueError once it is more than the file."""
            assert self.bio
            start = self.bio.tell()
            super().read_index_data(pos, indexes)
            self._indexed_bytes += self.bio.tell() - start
            if self._indexed_bytes > self.path.stat().st_size:
                raise ValueError('its index lists a chunk more than once')

        def read_chunk(self) -> Any:
            """Read the head of a chunk."""
            chunk = super().read_chunk()

            def bounded(data: bytes) -> bytes:
                content = inflate(data, names[chunk.decompressor], self._limits.chunk_bytes)
                # One chunk is held: messages of two in turn would have both inflated each time.
                self._inflated_bytes += len(content)
                size = self.path.stat().st_size
                self._limits.refuse_bomb(self.path, self._inflated_bytes, size)
                return content

            return chunk._replace(decompressor=bounded)

    return BoundedBag


def _check_magic(path: Path, magic: bytes) -> None:
    """Refuse what is no recording before its first line is looked for, of whatever length."""
    with path.open('rb') as file:
        if file.read(len(magic)) != magic:
            raise SourceError(f'{path}: does not begin as a recording does')


def _check_metadata(path: Path, reading: ReadingConfig) -> None:
    """Refuse parts that stand for others, of which a few lines make terabytes."""
    refuse = functools.partial(reading.refuse_file, cost=AS_YAML)
    text = read_bytes(path, "a recorder's metadata", refuse)
    if _ALIAS.search(text) and b'&' in text:
        raise SourceError(f'{path}: has aliases, such as *name; write their content instead')


def _check_database(path: Path) -> None:
    """Refuse what is cut short, of which SQLite reads zeros, computed columns and shared pages."""
    with path.open('rb') as file:
        head = file.read(_SQLITE_HEAD.size)
    size = path.stat().st_size
    if len(head) < _SQLITE_HEAD.size:
        raise SourceError(f'{path}: {size} bytes are not a recording')
    magic, page_bytes, pages = _SQLITE_HEAD.unpack(head)
    expected = (65536 if page_bytes == 1 else page_bytes) * pages
    if magic != _SQLITE_MAGIC:
        raise SourceError(f'{path}: not an SQLite file')
    if size < expected:
        raise SourceError(f'{path}: cut short, {size} of {expected} bytes are there')
    database = sqlite3.connect(f'{path.absolute().as_uri()}?immutable=1', uri=True)
    try:
        left = [_STEPS_FREE + _STEPS_A_BYTE * size]

        def go_on() -> bool:
            left[0] -= _STEPS_AT_ONCE
            return left[0] < 0

        database.set_progress_handler(go_on, _STEPS_AT_ONCE)
        database.execute('PRAGMA trusted_schema = OFF')
        _check_tables(path, database)
        held = 'SELECT count(*), coalesce(sum(length(data)), 0) FROM messages'
        rows, content = database.execute(held).fetchone()
        if rows > size or content > size:
            raise SourceError(
                f'{path}: its {size} bytes cannot hold {rows} messages of {content} bytes'
            )
    except (sqlite3.Error, OverflowError, ValueError, TypeError) as error:
        raise SourceError(f'{path}: {error}') from None
    finally:
        database.close()


def _check_tables(path: Path, database: sqlite3.Connection) -> None:
    for kind, name, told in database.execute('SELECT type, name, sql FROM sqlite_master'):
        plain = kind in ('table', 'index') and not re.match(r'\s*CREATE\s+VIRTUAL', told or '')
        if not plain:
            raise SourceError(f'{path}: {name} is no plain table; recordings have none such')
    for table in _TABLES:
        for _, name, *_, hidden in database.execute(f'PRAGMA table_xinfo({table})'):
            if hidden:
                raise SourceError(f'{path}: {table}.{name} is computed, not stored')
