# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A .db3 of rosbag2: two tables of SQLite, with a limit on the memory of a message.

rosbags gives SQLite the path unquoted, so it opens none with #, ? or % in its name.
"""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
import shutil
import sqlite3
import struct
from tempfile import TemporaryDirectory
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import SourceError
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topics import Index, merge_topics, Topic

_HEAD = struct.Struct('>16sH10xI')  # magic, bytes in a page (1 = 65536), pages
_MAGIC = b'SQLite format 3\0'
_TIMES = 'SELECT min(timestamp), max(timestamp) FROM messages'
_TOPICS = """
SELECT name, type, (SELECT count(*) FROM messages WHERE topic_id = topics.id) FROM topics
"""
_MESSAGES = """
SELECT timestamp, topics.type, data FROM messages JOIN topics ON topics.id = topic_id
WHERE topics.name = ? ORDER BY timestamp
"""


def index(path: Path, reading: ReadingConfig) -> Index:
    """Return the index of a .db3; SourceError if it is cut short."""
    with _opened(path, reading) as database:
        rows = database.execute(_TOPICS).fetchall()
        topics = merge_topics({name: Topic(name, kind, count)} for name, kind, count in rows)
        first, last = database.execute(_TIMES).fetchone()
    return Index(topics, first or 0, last or 0)


def messages(
    path: Path, reading: ReadingConfig, topic: str, _report: Any = None
) -> Iterator[RawMessage]:
    """Yield the messages of a topic in order of recording."""
    with _opened(path, reading) as database:
        for stamp_ns, kind, data in database.execute(_MESSAGES, (topic,)):
            yield RawMessage(int(stamp_ns), kind, bytes(data))


@contextmanager
def _opened(path: Path, reading: ReadingConfig) -> Iterator[sqlite3.Connection]:
    """Open a file read-only; refuse one that is cut short."""
    with _with_log(path) as plain:
        size, expected = plain.stat().st_size, _declared_size(plain)
        if size < expected:  # SQLite would read zeros
            raise SourceError(f'cut short, {size} of {expected} bytes are there')
        uri = f'{plain.absolute().as_uri()}?immutable=1'
        with closing(sqlite3.connect(uri, uri=True)) as database:
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, reading.most_bytes)
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
