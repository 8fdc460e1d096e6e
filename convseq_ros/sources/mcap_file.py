# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An mcap file, read by chunks from its start up to the first damage."""

from collections.abc import Iterator
from io import BytesIO
import os
from pathlib import Path
import struct
from typing import Any, IO

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import one_line, SourceError
from convseq_ros.sources.inflate import inflate, inflated_file
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topics import Index, merge_topics, Topic

_MAGIC = b'\x89MCAP0\r\n'
_HEAD = struct.Struct('<BQ')  # of a record: its kind, and how many bytes follow
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6
_CHUNK_HEAD_BYTES = 100  # more than the bytes before a chunk's records
# In a compressed file, a record that differs from the last only in two stamps takes more bytes.
_FEW_RECORDS, _LEAST_BYTES = 100, 2


def index(path: Path, reading: ReadingConfig) -> Index:
    """Return the index by a file's summary; without one, by its content up to the first damage."""
    with inflated_file(path, reading) as plain:
        return _summary(plain, reading) or _counted(plain, reading)


def messages(path: Path, reading: ReadingConfig, topic: str) -> Iterator[RawMessage]:
    """Yield the messages of a topic in the order of the file; SourceError at the first damage."""
    with inflated_file(path, reading) as plain:
        yield from (message for message, name in _messages(plain, reading) if name == topic)


def _summary(path: Path, reading: ReadingConfig) -> Index | None:
    from mcap.reader import SeekingReader

    try:
        with path.open('rb') as file:
            summary: Any = SeekingReader(file, record_size_limit=reading.most_bytes).get_summary()
        counts, times = summary.statistics.channel_message_counts, summary.statistics
        topics = merge_topics(
            {item.topic: Topic(item.topic, summary.schemas[item.schema_id].name, counts.get(i, 0))}
            for i, item in summary.channels.items()
            if item.message_encoding == 'cdr'
        )
        duration_ns = max(0, times.message_end_time - times.message_start_time)
    except Exception:  # mcap may raise any error for a damaged file
        return None
    return Index(topics, duration_ns / 1e9) if topics else None


def _counted(path: Path, reading: ReadingConfig) -> Index:
    topics: dict[str, Topic] = {}
    times_ns: list[int] = []
    size, problem = path.stat().st_size, 'its index cannot be used, so it was read from the start'
    try:
        for message, topic in _messages(path, reading):
            times_ns = [*times_ns[:1], message.log_time_ns]
            count = topics[topic].count if topic in topics else 0
            topics[topic] = Topic(topic, message.type_name, count + 1)
    except SourceError as error:
        if not topics:
            raise
        problem = f'cut short or damaged ({error}) of {size} bytes'
    if not topics:
        raise SourceError(f'no whole message in its {size} bytes of mcap; record again')
    return Index(topics, max(0, times_ns[-1] - times_ns[0]) / 1e9, problem)


def _messages(path: Path, reading: ReadingConfig) -> Iterator[tuple[RawMessage, str]]:
    """Yield messages and their topics; SourceError at the first damage."""
    types: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    records_left = _FEW_RECORDS + path.stat().st_size // _LEAST_BYTES
    for kind, record in _records_of_file(path, reading):
        records_left -= 1
        if records_left < 0:
            raise SourceError('it holds more records than its size allows')
        if kind == _SCHEMA:
            types[record.id] = record.name
        elif kind == _CHANNEL and record.message_encoding == 'cdr':
            channels[record.id] = (record.topic, types.get(record.schema_id, ''))
        elif kind == _MESSAGE and record.channel_id in channels:
            topic, type_name = channels[record.channel_id]
            yield RawMessage(record.log_time, type_name, record.data), topic


def _records_of_file(path: Path, reading: ReadingConfig) -> Iterator[tuple[int, Any]]:
    """Yield the kind and the content of records, also of those in chunks."""
    with path.open('rb') as file:
        size, inflated = os.fstat(file.fileno()).st_size, 0
        if file.read(len(_MAGIC)) != _MAGIC:
            raise SourceError('not an mcap file; check that it is the recording')
        for kind, record in _records(file, size, reading):
            if kind == _FOOTER:
                return
            if kind != _CHUNK:
                yield kind, record
                continue
            inflated += record.uncompressed_size
            reading.refuse_bomb('it', inflated, size)
            _refuse_large(reading, record.uncompressed_size)
            try:
                content = inflate(record.data, record.compression, record.uncompressed_size)
                for inner in _records(BytesIO(content), len(content), reading):
                    if inner[0] != _CHUNK:
                        yield inner
            except Exception as error:
                raise SourceError(f'at byte {file.tell()}: {one_line(error)}') from None
    raise SourceError(f'at byte {size}: it has no end')


def _records(file: IO[bytes], size: int, reading: ReadingConfig) -> Iterator[tuple[int, Any]]:
    """Yield records of one level; after a chunk that is cut short, raise a SourceError."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Chunk, Message, Schema

    readers = {_SCHEMA: Schema.read, _CHANNEL: Channel.read, _CHUNK: Chunk.read}
    at = file.tell()
    while len(head := file.read(_HEAD.size)) == _HEAD.size:
        kind, length = _HEAD.unpack(head)
        start, at = at, at + _HEAD.size + length
        is_whole = at <= size
        if kind == _CHUNK or (is_whole and kind in (_SCHEMA, _CHANNEL, _MESSAGE)):
            _refuse_large(reading, min(length, size) - _CHUNK_HEAD_BYTES)
            data = ReadDataStream(BytesIO(file.read(length)))
            try:
                if kind == _MESSAGE:
                    record: Any = Message.read(data, length)
                else:
                    record = readers[kind](data)
            except Exception:
                raise SourceError(f'at byte {start}') from None
            yield kind, record
        elif kind == _FOOTER:
            yield kind, None
        if not kind or not is_whole:
            raise SourceError(f'at byte {start}')
        file.seek(at)
    if at != size:
        raise SourceError(f'at byte {at}')


def _refuse_large(reading: ReadingConfig, size: int) -> None:
    reading.refuse_above('max_file_mb', size / 1e6, f'a chunk of {size / 1e6:.4g} MB')
