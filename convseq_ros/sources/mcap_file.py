# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An mcap file, read record by record up to where it breaks; damaged chunks are left out."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import one_line, SourceError
from convseq_ros.sources.inflate import inflate
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topics import ForeignRecording, Index, merge_topics, Topic

_CDR = 'cdr'  # encoding of the messages of ROS 2
_HEAD_BYTES = 100  # more than the bytes of a chunk before its content


def index(path: Path, reading: ReadingConfig) -> Index:
    """Return the index by a file's summary; without one, by its content up to the first damage."""
    file = _File(path, reading)
    file.refuse_foreign()
    return file.index() or _counted(file)


def messages(
    path: Path, reading: ReadingConfig, topic: str, report: Callable[[str], None]
) -> Iterator[RawMessage]:
    """
    Yield the messages of a topic in the order of the file; SourceError where it breaks.

    Damaged chunks, which do not suit their checksum, are left out, and reported in a line.
    """
    file = _File(path, reading)
    yield from (message for message, name in file.messages() if name == topic)
    if file.damaged_at:
        count, first = len(file.damaged_at), file.damaged_at[0]
        report(f'damaged chunks: {count}, the first at byte {first}; left out: copy it again')


def _counted(file: '_File') -> Index:
    topics: dict[str, Topic] = {}
    times_ns: list[int] = []
    size, problem = file.size, 'its index cannot be used, so it was read from the start'
    try:
        for message, topic in file.messages():
            times_ns = [*times_ns[:1], message.log_time_ns]
            count = topics[topic].count if topic in topics else 0
            topics[topic] = Topic(topic, message.type_name, count + 1)
    except SourceError as error:
        if not topics:
            file.refuse_foreign()
            raise
        problem = f'cut short or damaged ({error}) of {size} bytes'
    if not topics:
        file.refuse_foreign()
        raise SourceError(f'no whole message in its {size} bytes of mcap; record again')
    return Index(topics, times_ns[0], times_ns[-1], problem)


class _File:
    """An mcap file, its summary, and what it declares while it is read."""

    def __init__(self, path: Path, reading: ReadingConfig) -> None:
        from mcap.reader import SeekingReader

        self._path, self._reading, self.size = path, reading, path.stat().st_size
        self._most_bytes = reading.most_bytes + _HEAD_BYTES
        self.damaged_at: list[int] = []  # first bytes of chunks that were left out
        self._summary: Any = None
        try:
            with path.open('rb') as file:
                reader = SeekingReader(file, record_size_limit=self._most_bytes)
                self._summary = reader.get_summary()
        except Exception:  # mcap may raise any error for a damaged file
            self._summary = None
        # A damaged chunk may be the one that declares a channel.
        self._schemas: dict[int, Any] = dict(self._summary.schemas) if self._summary else {}
        self._channels: dict[int, Any] = dict(self._summary.channels) if self._summary else {}

    def index(self) -> Index | None:
        """Return the index by the summary; None if it has no counts, or none of ROS."""
        if not (self._summary and self._summary.statistics):
            return None
        about = self._summary.statistics
        counts, channels = about.channel_message_counts, self._channels.items()
        topics = merge_topics(
            {channel.topic: Topic(channel.topic, self._type(channel), counts.get(number, 0))}
            for number, channel in channels
            if channel.message_encoding == _CDR
        )
        if not topics:
            return None
        return Index(topics, int(about.message_start_time), int(about.message_end_time))

    def refuse_foreign(self) -> None:
        """Raise a ForeignRecording if there are channels, but none of ROS 2."""
        channels = [*self._channels.values()]
        if channels and all(channel.message_encoding != _CDR for channel in channels):
            topic, encoding = channels[0].topic, channels[0].message_encoding
            remedy = 'give the .bag that it was made of' if encoding == 'ros1' else 'convert it'
            raise ForeignRecording(
                f'its messages are {encoding}, such as {topic} ({self._type(channels[0])}), and '
                f'not {_CDR} as ROS 2 writes them; {remedy}'
            )

    def messages(self) -> Iterator[tuple[RawMessage, str]]:
        """Yield messages and their topics; SourceError where the file breaks."""
        from mcap.records import Channel, Message, Schema

        for record in self._records():
            if isinstance(record, Schema):
                self._schemas.setdefault(record.id, record)
            elif isinstance(record, Channel):
                self._channels.setdefault(record.id, record)
            elif isinstance(record, Message) and record.channel_id in self._channels:
                channel = self._channels[record.channel_id]
                if channel.message_encoding == _CDR:
                    kind = self._type(channel)
                    yield RawMessage(record.log_time, kind, record.data), channel.topic

    def _type(self, channel: Any) -> str:
        schema = self._schemas.get(channel.schema_id)
        return str(schema.name) if schema else ''

    def _records(self) -> Iterator[Any]:
        """Yield the records of the file, also those in chunks."""
        from mcap.exceptions import RecordLengthLimitExceeded
        from mcap.records import Chunk
        from mcap.stream_reader import StreamReader

        inflated, limit = 0, self._most_bytes
        with self._path.open('rb') as file:
            records = StreamReader(file, emit_chunks=True, record_size_limit=limit).records
            while True:
                start = file.tell()
                try:
                    record = next(records, None)
                except Exception as error:
                    is_large = isinstance(error, RecordLengthLimitExceeded)
                    remedy = '; raise max_file_mb if there is memory' if is_large else ''
                    raise SourceError(f'at byte {start}: {one_line(error)}{remedy}') from None
                if record is None:
                    return
                if isinstance(record, Chunk):
                    inflated += record.uncompressed_size
                    self._reading.refuse_bomb('it', inflated, self.size)
                    yield from self._records_of(record, start)
                else:
                    yield record

    def _records_of(self, chunk: Any, start: int) -> list[Any]:
        """Return the records of a chunk; none if it is damaged. SourceError if it is too large."""
        from mcap.stream_reader import breakup_chunk

        size = chunk.uncompressed_size
        self._reading.refuse_above('max_file_mb', size / 1e6, f'a chunk of {size / 1e6:.4g} MB')
        try:
            content = inflate(chunk.data, chunk.compression, size)
            plain = replace(chunk, data=content, compression='')
            return breakup_chunk(plain, validate_crc=True)
        except (SourceError, ImportError):
            raise
        except Exception:  # of mcap, or of the compression's library
            self.damaged_at.append(start)
            return []
