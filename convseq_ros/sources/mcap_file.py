# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An mcap file, read by chunks from its start up to the first damage."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
import os
from pathlib import Path
import struct
from typing import Any, IO
import zlib

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import one_line, SourceError
from convseq_ros.sources.inflate import inflate, inflated_file
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topics import ForeignRecording, Index, merge_topics, Topic

_MAGIC = b'\x89MCAP0\r\n'
_HEAD = struct.Struct('<BQ')  # of a record: its kind, and how many bytes follow
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6
_CUT_CHUNK, _LOST_CHUNK = 256, 257  # which the end of the file cuts; which is damaged
_CHUNK_HEAD_BYTES = 100  # more than the bytes before a chunk's records
# In a compressed file, a record that differs from the last only in two stamps takes more bytes.
_FEW_RECORDS, _LEAST_BYTES = 100, 2
_CDR = 'cdr'  # encoding of the messages of ROS 2

Report = Callable[[str], None]


@dataclass
class _Content:
    """What a file declares while it is read, and where its damaged chunks are."""

    types: dict[int, str] = field(default_factory=dict)  # of schemas, by id
    channels: dict[int, tuple[str, str, str]] = field(
        default_factory=dict
    )  # topic, type, encoding
    damaged_at: list[int] = field(default_factory=list)  # first bytes of chunks

    def add_channel(self, channel: Any) -> None:
        """Note a channel, after its schema."""
        about = channel.topic, self.types.get(channel.schema_id, ''), channel.message_encoding
        self.channels.setdefault(channel.id, about)

    def refuse_foreign(self) -> None:
        """Raise a ForeignRecording if there are channels, but none of ROS 2."""
        if self.channels and all(encoding != _CDR for *_, encoding in self.channels.values()):
            topic, kind, encoding = next(iter(self.channels.values()))
            remedy = 'give the .bag that it was made of' if encoding == 'ros1' else 'convert it'
            raise ForeignRecording(
                f'its messages are {encoding}, such as {topic} ({kind}), and not {_CDR} as ROS 2 '
                f'writes them; {remedy}'
            )


def index(path: Path, reading: ReadingConfig) -> Index:
    """Return the index by a file's summary; without one, by its content up to the first damage."""
    with inflated_file(path, reading) as plain:
        return _index_of(_summary(plain, reading)) or _counted(plain, reading)


def messages(
    path: Path, reading: ReadingConfig, topic: str, report: Report
) -> Iterator[RawMessage]:
    """
    Yield the messages of a topic in the order of the file; SourceError at the first damage.

    Chunks that do not suit their checksum are left out, and reported in a line.
    """
    with inflated_file(path, reading) as plain:
        # A damaged chunk may be the one that declares a channel.
        content = _declared(_summary(plain, reading))
        found = _messages(plain, reading, content)
        yield from (message for message, name in found if name == topic)
    if content.damaged_at:
        count, first = len(content.damaged_at), content.damaged_at[0]
        report(f'damaged chunks: {count}, the first at byte {first}; left out: copy it again')


def _summary(path: Path, reading: ReadingConfig) -> Any | None:
    from mcap.reader import SeekingReader

    try:
        with path.open('rb') as file:
            return SeekingReader(file, record_size_limit=reading.most_bytes).get_summary()
    except Exception:  # mcap may raise any error for a damaged file
        return None


def _declared(summary: Any | None) -> _Content:
    """Return the channels of a summary; none if it is damaged."""
    schemas = summary.schemas if summary else {}
    content = _Content({number: schema.name for number, schema in schemas.items()})
    if summary is not None:
        for channel in summary.channels.values():
            content.add_channel(channel)
    return content


def _index_of(summary: Any | None) -> Index | None:
    content = _declared(summary)
    content.refuse_foreign()
    try:
        counts, times = summary.statistics.channel_message_counts, summary.statistics  # type: ignore[union-attr]
        topics = merge_topics(
            {topic: Topic(topic, kind, counts.get(number, 0))}
            for number, (topic, kind, encoding) in content.channels.items()
            if encoding == _CDR
        )
        start_ns, end_ns = int(times.message_start_time), int(times.message_end_time)
    except (AttributeError, TypeError):
        return None
    return Index(topics, start_ns, end_ns) if topics else None


def _counted(path: Path, reading: ReadingConfig) -> Index:
    topics: dict[str, Topic] = {}
    times_ns: list[int] = []
    size, problem = path.stat().st_size, 'its index cannot be used, so it was read from the start'
    content = _Content()
    try:
        for message, topic in _messages(path, reading, content):
            times_ns = [*times_ns[:1], message.log_time_ns]
            count = topics[topic].count if topic in topics else 0
            topics[topic] = Topic(topic, message.type_name, count + 1)
    except SourceError as error:
        if not topics:
            raise
        problem = f'cut short or damaged ({error}) of {size} bytes'
    if not topics:
        content.refuse_foreign()
        raise SourceError(f'no whole message in its {size} bytes of mcap; record again')
    return Index(topics, times_ns[0], times_ns[-1], problem)


def _messages(
    path: Path, reading: ReadingConfig, content: _Content
) -> Iterator[tuple[RawMessage, str]]:
    """Yield messages and their topics; SourceError at the first damage."""
    records_left = _FEW_RECORDS + path.stat().st_size // _LEAST_BYTES
    for kind, record in _records_of_file(path, reading):
        records_left -= 1
        if records_left < 0:
            raise SourceError('it holds more records than its size allows')
        if kind == _SCHEMA:
            content.types.setdefault(record.id, record.name)
        elif kind == _CHANNEL:
            content.add_channel(record)
        elif kind == _LOST_CHUNK:
            content.damaged_at.append(record)
        elif kind == _MESSAGE and record.channel_id in content.channels:
            topic, type_name, encoding = content.channels[record.channel_id]
            if encoding == _CDR:
                yield RawMessage(record.log_time, type_name, record.data), topic


def _records_of_file(path: Path, reading: ReadingConfig) -> Iterator[tuple[int, Any]]:
    """Yield the kind and the content of records, also of those in chunks."""
    with path.open('rb') as file:
        size, inflated = os.fstat(file.fileno()).st_size, 0
        if file.read(len(_MAGIC)) != _MAGIC:
            raise SourceError('not an mcap file; check that it is the recording')
        for start, kind, record in _records(file, size, reading):
            if kind == _FOOTER:
                return
            if kind not in (_CHUNK, _CUT_CHUNK):
                yield kind, record
                continue
            inflated += record.uncompressed_size
            reading.refuse_bomb('it', inflated, size)
            _refuse_large(reading, record.uncompressed_size)
            try:
                content, is_lost = _inflated(record, kind == _CHUNK)
                if is_lost:
                    yield _LOST_CHUNK, start
                yield from _records_of_chunk(content, reading, is_lost)
            except SourceError as error:
                raise SourceError(f'at byte {start}: {error}') from None
    raise SourceError(f'at byte {size}: it has no end')


def _inflated(chunk: Any, is_whole: bool) -> tuple[bytes, bool]:
    """Return a chunk's content, and whether it is damaged; SourceError if a part is unreadable."""
    try:
        content = inflate(chunk.data, chunk.compression, chunk.uncompressed_size)
    except SourceError:
        raise
    except Exception as error:  # of the compression's library
        if is_whole:
            return b'', True
        raise SourceError(one_line(error)) from None
    crc = chunk.uncompressed_crc  # 0 for none
    return content, bool(is_whole and crc and zlib.crc32(content) != crc)


def _records_of_chunk(
    content: bytes, reading: ReadingConfig, is_lost: bool
) -> Iterator[tuple[int, Any]]:
    """Yield a chunk's records; if it is damaged, only what it declares, as far as it goes."""
    kinds = (_SCHEMA, _CHANNEL) if is_lost else (_SCHEMA, _CHANNEL, _MESSAGE)
    try:
        for _, kind, record in _records(BytesIO(content), len(content), reading):
            if kind in kinds:
                yield kind, record
    except SourceError:
        if not is_lost:
            raise


def _records(file: IO[bytes], size: int, reading: ReadingConfig) -> Iterator[tuple[int, int, Any]]:
    """Yield first byte, kind and content of records; after a cut one, raise a SourceError."""
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
            yield start, kind if is_whole else _CUT_CHUNK, record
        elif kind == _FOOTER:
            yield start, kind, None
        if not kind or not is_whole:
            raise SourceError(f'at byte {start}')
        file.seek(at)
    if at != size:
        raise SourceError(f'at byte {at}')


def _refuse_large(reading: ReadingConfig, size: int) -> None:
    reading.refuse_above('max_file_mb', size / 1e6, f'a chunk of {size / 1e6:.4g} MB')
