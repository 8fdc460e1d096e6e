# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a recording, whole or damaged, behind one interface."""

from collections.abc import Iterator
from pathlib import Path
import re
import struct
from typing import Any, Protocol

from convseq_ros.errors import SourceError
from convseq_ros.sources.natural_order import natural_key
from convseq_ros.sources.raw_message import one_line, RawMessage, typestore
from convseq_ros.sources.topics import Topic
from convseq_ros.sources.truncated_mcap import TruncatedMcap

_SQLITE_MAGIC = b'SQLite format 3\0'
_SQLITE_HEAD = struct.Struct('>16sH10xI')  # magic, bytes in a page (1 = 65536), pages
STORAGE_SUFFIXES = ('.mcap', '.db3', '.bag')
REPAIRS = {'.mcap': 'mcap recover', '.db3': 'sqlite3 FILE .recover', '.bag': 'rosbag reindex'}


class Storage(Protocol):
    """One file of a recording, or several that share an index."""

    path: Path
    topics: dict[str, Topic]
    damage: str

    def messages(self, topic: str) -> Iterator[RawMessage]:
        """Yield the messages of a topic as recorded; each call starts anew."""


def is_storage_file(path: Path) -> bool:
    """Tell whether a name is that of a recording's file, compressed as a whole or not."""
    return re.search(r'\.(mcap|db3|bag)(\.zstd)?$', path.name.lower()) is not None


def open_storage(path: Path) -> tuple[list[Storage], list[str]]:
    """
    Open whatever can be read of a recording.

    Parameters
    ----------
    path : Path
        A .mcap, .db3 or .bag file, or the folder that a recorder wrote.

    Returns
    -------
    storages : list of Storage
        In order of recording; at least one.
    warnings : list of str
        One line for every file that had to be left out, and for an unusable index.

    Raises
    ------
    SourceError
        If nothing can be read.

    """
    if not path.exists():
        raise SourceError(f'{path}: no such file or folder; check the path')
    if not path.is_dir():
        return [_open_file(path)], []
    problem = SourceError(
        f'{path}: no recording in this folder; expected a .mcap, .db3 or .bag file'
    )
    warnings: list[str] = []
    storages: list[Storage] = []
    unusable_index = ''
    if (path / 'metadata.yaml').exists():
        try:
            return [IndexedStorage(path)], []
        except SourceError as error:
            problem = error
            unusable_index = f'{error}; its files were read one by one'
    for file in sorted(path.iterdir(), key=natural_key):
        if file.suffix.lower() in STORAGE_SUFFIXES:
            try:
                storages.append(_open_file(file))
            except SourceError as error:
                problem = error
                warnings.append(f'{error}; the file was left out')
    if not storages:
        raise problem
    if unusable_index and not warnings and not any(item.damage for item in storages):
        warnings.append(unusable_index)
    return storages, warnings


def _open_file(path: Path) -> Storage:
    if path.suffix.lower() not in STORAGE_SUFFIXES:
        raise SourceError(
            f'{path}: not a recording; expected a folder or a {", ".join(STORAGE_SUFFIXES)} file'
        )
    try:
        return IndexedStorage(path)
    except SourceError:
        if path.suffix.lower() != '.mcap':
            raise
        return TruncatedMcap(path)


class IndexedStorage:
    """
    A recording that is whole, read through its index by rosbags.

    Raises
    ------
    SourceError
        If it is not whole; while iterating, if a damaged message is met.

    """

    damage = ''

    def __init__(self, path: Path) -> None:
        typestore()
        self.path = path
        for database in [path] if path.suffix.lower() == '.db3' else path.glob('*.db3'):
            _refuse_cut_database(database)
        try:
            with self._reader() as reader:
                self._is_ros1 = not reader.is2
                self.topics = {
                    name: Topic(name, info.msgtype or 'several types', int(info.msgcount))
                    for name, info in reader.topics.items()
                }
        except Exception as error:
            raise SourceError(
                f'{path}: not a readable recording ({one_line(error)}); {_advice(path)}'
            ) from None

    def _reader(self) -> Any:
        from rosbags.highlevel import AnyReader

        return AnyReader([self.path], default_typestore=typestore())

    def messages(self, topic: str) -> Iterator[RawMessage]:
        """Yield the messages of a topic in order of recording, those of ROS 1 as CDR."""
        count = 0
        try:
            with self._reader() as reader:
                chosen = [item for item in reader.connections if item.topic == topic]
                if not chosen:
                    return
                for connection, log_time_ns, data in reader.messages(chosen):
                    cdr = _ros1_to_cdr(data, connection.msgtype) if self._is_ros1 else bytes(data)
                    yield RawMessage(log_time_ns, connection.msgtype, cdr)
                    count += 1
        except Exception as error:
            raise SourceError(
                f'{self.path}: damaged after {count} messages of {topic} ({one_line(error)}); '
                f'{_advice(self.path)}'
            ) from None


def _refuse_cut_database(path: Path) -> None:
    """Compare sizes, because SQLite reads zeros where the end of its file is missing."""
    try:
        with path.open('rb') as file:
            head = file.read(_SQLITE_HEAD.size)
        size = path.stat().st_size
    except OSError as error:
        raise SourceError(f'{path}: {error.strerror}; check its permissions') from None
    if len(head) < _SQLITE_HEAD.size:
        raise SourceError(f'{path}: {size} bytes are not a recording; {_advice(path)}')
    magic, page_bytes, pages = _SQLITE_HEAD.unpack(head)
    expected = (65536 if page_bytes == 1 else page_bytes) * pages
    if magic == _SQLITE_MAGIC and size < expected:
        raise SourceError(
            f'{path}: cut short, {size} of {expected} bytes are there; {_advice(path)}'
        )


def _ros1_to_cdr(data: bytes, type_name: str) -> bytes:
    try:
        return bytes(typestore().ros1_to_cdr(data, type_name))
    except Exception:
        return b''


def _advice(path: Path) -> str:
    repair = REPAIRS.get(path.suffix.lower())
    return f'repair it with `{repair}` or record again' if repair else 'check its metadata.yaml'
