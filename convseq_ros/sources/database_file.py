# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A .db3 of rosbag2: two tables of SQLite, with limits on memory and time."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
import re
import shutil
import sqlite3
import struct
from tempfile import TemporaryDirectory
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import SourceError
from convseq_ros.sources.inflate import inflate, inflated_file
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topics import Index, merge_topics, Topic

_HEAD = struct.Struct('>16sH10xI')  # magic, bytes in a page (1 = 65536), pages
_MAGIC = b'SQLite format 3\0'
# A row takes at least 4 bytes of the file; counting it takes some 20 steps of SQLite's machine.
_STEPS_AT_ONCE, _STEPS_FREE, _STEPS_A_BYTE = 100_000, 10_000_000, 10
_ZSTD = b'\x28\xb5\x2f\xfd'  # start of a compressed message; others start with 0
_TIMES = 'SELECT min(timestamp), max(timestamp) FROM messages'
_TOPICS = """
SELECT name, type, (SELECT count(*) FROM messages WHERE topic_id = topics.id) FROM topics
"""
_MESSAGES = """
SELECT timestamp, topics.type, data FROM messages JOIN topics ON topics.id = topic_id
WHERE topics.name = ? ORDER BY timestamp
"""


def index(path: Path, reading: ReadingConfig) -> Index:
    """Return the index of a .db3 or .db3.zstd; SourceError if cut short or not plain tables."""
    with _opened(path, reading) as database:
        rows = database.execute(_TOPICS).fetchall()
        topics = merge_topics({name: Topic(name, kind, count)} for name, kind, count in rows)
        first, last = database.execute(_TIMES).fetchone()
    return Index(topics, first or 0, last or 0)


def messages(
    path: Path, reading: ReadingConfig, topic: str, _report: Any = None
) -> Iterator[RawMessage]:
    """Yield the messages of a topic in order of recording; each may be compressed."""
    with _opened(path, reading) as database:
        for stamp_ns, kind, data in database.execute(_MESSAGES, (topic,)):
            content = bytes(data)
            if content.startswith(_ZSTD):
                content = inflate(content, 'zstd', reading.most_bytes)
            yield RawMessage(int(stamp_ns), kind, content)


@contextmanager
def _opened(path: Path, reading: ReadingConfig) -> Iterator[sqlite3.Connection]:
    """Open a file read-only; refuse computed tables, and more content than its size allows."""
    with inflated_file(path, reading) as inflated, _with_log(inflated) as plain:
        size, expected = plain.stat().st_size, _declared_size(plain)
        if size < expected:  # SQLite would read zeros
            raise SourceError(f'cut short, {size} of {expected} bytes are there')
        uri = f'{plain.absolute().as_uri()}?immutable=1'
        with closing(sqlite3.connect(uri, uri=True)) as database:
            steps_left = [_STEPS_FREE + _STEPS_A_BYTE * size]

            def is_too_long() -> bool:
                steps_left[0] -= _STEPS_AT_ONCE
                return steps_left[0] < 0

            database.set_progress_handler(is_too_long, _STEPS_AT_ONCE)
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, reading.most_bytes)
            database.execute('PRAGMA trusted_schema = OFF')
            _refuse_computed(database)
            query = 'SELECT count(*), coalesce(sum(length(data)), 0) FROM messages'
            rows, content = database.execute(query).fetchone()
            if rows > size or content > size:
                raise SourceError(
                    f'its {size} bytes cannot hold {rows} messages of {content} bytes'
                )
            yield database


@contextmanager
def _with_log(path: Path) -> Iterator[Path]:
    """Yield a file; if a recorder was killed, a copy that has the messages of its -wal file."""
    log = path.with_name(f'{path.name}-wal')
    if not log.is_file() or not log.stat().st_size:
        yield path
        return
    is_cut = path.stat().st_size < _declared_size(path)
    with TemporaryDirectory(prefix='convseq_') as folder:
        copy = Path(folder, 'recording.db3')
        shutil.copyfile(path, copy)
        shutil.copyfile(log, f'{copy}-wal')
        with closing(sqlite3.connect(copy)) as database:
            database.execute('PRAGMA wal_checkpoint(TRUNCATE)')
            # The log may hold what the file lacks; what neither has, SQLite reads as zeros.
            if is_cut and database.execute('PRAGMA quick_check(1)').fetchone() != ('ok',):
                raise SourceError('cut short, and its -wal file does not hold the rest')
        yield copy


def _declared_size(path: Path) -> int:
    """Return the size in bytes that a database's head tells; SourceError if it is none."""
    with path.open('rb') as file:
        head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        raise SourceError(f'{path.stat().st_size} bytes are not a recording')
    magic, page_bytes, pages = _HEAD.unpack(head)
    if magic != _MAGIC:
        raise SourceError('not an SQLite file')
    return int((65536 if page_bytes == 1 else page_bytes) * pages)


def _refuse_computed(database: sqlite3.Connection) -> None:
    for kind, name, text in database.execute('SELECT type, name, sql FROM sqlite_master'):
        plain = kind in ('table', 'index') and not re.match(r'\s*CREATE\s+VIRTUAL', text or '')
        if not plain:
            raise SourceError(f'{name} is not a plain table; a recording has no others')
    for table in ('messages', 'topics'):
        for _, name, *_, hidden in database.execute(f'PRAGMA table_xinfo({table})'):
            if hidden:
                raise SourceError(f'{table}.{name} is computed, not stored')
