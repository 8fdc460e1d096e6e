# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a recording, whole or damaged, behind one interface."""

from collections.abc import Callable, Iterator
import functools
from pathlib import Path
import re
from typing import Any, Protocol

from convseq_ros.errors import SourceError
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.regular_file import refuse_irregular
from convseq_ros.sources.bounded_readers import check_chunks, open_bounded
from convseq_ros.sources.inflate import inflate, RecordingLimits
from convseq_ros.sources.natural_order import natural_key
from convseq_ros.sources.raw_message import one_line, RawMessage, typestore
from convseq_ros.sources.topics import Topic
from convseq_ros.sources.truncated_mcap import TruncatedMcap

STORAGE_SUFFIXES = ('.mcap', '.db3', '.bag')
REPAIRS = {'.mcap': 'mcap recover', '.db3': 'sqlite3 FILE .recover', '.bag': 'rosbag reindex'}


class Storage(Protocol):
    """One file of a recording, or several that share an index."""

    path: Path
    topics: dict[str, Topic]
    damage: str
    duration_s: float  # from the first message of any topic to the last

    def messages(self, topic: str) -> Iterator[RawMessage]:
        """Yield the messages of a topic as recorded; each call starts anew."""


def is_storage_file(path: Path) -> bool:
    """Tell whether a name is that of a recording's file, compressed as a whole or not."""
    return re.search(r'\.(mcap|db3|bag)(\.zstd)?$', path.name.lower()) is not None


def open_storage(
    path: Path, reading: ReadingConfig = ReadingConfig()
) -> tuple[list[Storage], list[str]]:
    """
    Open whatever can be read of a .mcap, .db3 or .bag file, or the folder that a recorder wrote.

    Return its storages, at least one, in order of recording, and a line for every file that had to
    be left out, and for an unusable index. SourceError if nothing can be read.
    """
    refuse_irregular(path)
    limits = RecordingLimits(reading)
    if not path.exists():
        raise SourceError(f'{path}: no such file or folder; check the path')
    if not path.is_dir():
        return [_open_file(path, limits)], []
    problem = SourceError(
        f'{path}: no recording in this folder; expected a .mcap, .db3 or .bag file'
    )
    warnings: list[str] = []
    storages: list[Storage] = []
    unusable_index = ''
    if (path / 'metadata.yaml').exists():
        try:
            return [IndexedStorage(path, limits)], []
        except SourceError as error:
            problem = error
            unusable_index = f'{error}; its files were read one by one'
    for file in sorted(path.iterdir(), key=natural_key):
        if file.suffix.lower() in STORAGE_SUFFIXES:
            try:
                storages.append(_open_file(file, limits))
            except SourceError as error:
                problem = error
                warnings.append(f'{error}; the file was left out')
    if not storages:
        raise problem
    if unusable_index and not warnings and not any(item.damage for item in storages):
        warnings.append(unusable_index)
    return storages, warnings


def _open_file(path: Path, limits: RecordingLimits) -> Storage:
    if path.suffix.lower() not in STORAGE_SUFFIXES:
        raise SourceError(
            f'{path}: not a recording; expected a folder or a {", ".join(STORAGE_SUFFIXES)} file'
        )
    try:
        return IndexedStorage(path, limits)
    except SourceError:
        if path.suffix.lower() != '.mcap':
            raise
        return TruncatedMcap(path, limits)


class IndexedStorage:
    """
    A recording that is whole, read through its index by rosbags.

    Raises
    ------
    SourceError
        If it is not whole; while iterating, if a damaged message is met.

    """

    damage = ''

    def __init__(self, path: Path, limits: RecordingLimits) -> None:
        typestore()
        self.path, self._limits = path, limits
        try:
            with open_bounded(path, limits) as reader:
                self._is_ros1 = path.suffix.lower() == '.bag'
                self.duration_s = max(0, int(reader.duration)) / 1e9
                if not self._is_ros1:
                    check_chunks(path, reader, limits)
                self.topics = {
                    name: Topic(name, info.msgtype or 'several types', int(info.msgcount))
                    for name, info in reader.topics.items()
                }
        except Exception as error:
            raise SourceError(
                f'{path}: not a readable recording ({_told(error, path)}); {_advice(path)}'
            ) from None

    def messages(self, topic: str) -> Iterator[RawMessage]:
        """Yield the messages of a topic in order of recording, those of ROS 1 as CDR."""
        count = 0
        try:
            with open_bounded(self.path, self._limits) as reader:
                chosen = [item for item in reader.connections if item.topic == topic]
                if not chosen:
                    return
                content = _stored(reader, self._limits.chunk_bytes)
                for connection, log_time_ns, data in reader.messages(chosen):
                    cdr = _ros1_to_cdr(data, connection) if self._is_ros1 else content(data)
                    yield RawMessage(log_time_ns, connection.msgtype, cdr)
                    count += 1
        except Exception as error:
            raise SourceError(
                f'{self.path}: damaged after {count} messages of {topic} '
                f'({_told(error, self.path)}); {_advice(self.path)}'
            ) from None


def _stored(reader: Any, most_bytes: int) -> Callable[[bytes], bytes]:
    """Return how a message is to be had of what is stored: each may be compressed."""
    if getattr(reader, 'compression_mode', '') != 'message':
        return bytes
    # We inflate them ourselves, within bounds.
    reader.storage.metadata = reader.storage.metadata._replace(compression_mode=None)
    return functools.partial(inflate, compression='zstd', most_bytes=most_bytes)


def _told(error: Exception, path: Path) -> str:
    """Return what went wrong, without the name of the file that stands before it."""
    return one_line(error).removeprefix(f'{path}: ')


def _ros1_to_cdr(data: bytes, connection: Any) -> bytes:
    try:
        return bytes(typestore().ros1_to_cdr(data, connection.msgtype))
    except Exception:
        return b''


def _advice(path: Path) -> str:
    repair = REPAIRS.get(path.suffix.lower())
    return f'repair it with `{repair}` or record again' if repair else 'check its metadata.yaml'
