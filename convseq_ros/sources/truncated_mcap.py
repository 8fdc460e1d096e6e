# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What can be saved of an mcap file without its index, such as a crashed recorder leaves."""

from collections.abc import Iterator
from io import BytesIO
import mmap
from pathlib import Path
from typing import Any

from convseq_ros.errors import pip_install, SourceError
from convseq_ros.regular_file import refuse_irregular
from convseq_ros.sources.inflate import end_of_records, inflate, RecordingLimits
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topics import Topic

MAGIC = b'\x89MCAP0\r\n'
_RECORD_HEAD_BYTES = 9  # opcode, length of what follows
_CHUNK_TIMES_BYTES = 16  # first and last stamp
_NONE, _FOOTER, _CHUNK = b'\0', b'\2', b'\6'
_READ = (b'\3', b'\4', b'\5', _CHUNK)  # schema, channel, message


class TruncatedMcap:
    """
    An mcap file read from its start to where it ends or breaks, without its index.

    A chunk that is cut counts up to the cut; if compressed, up to its last whole block. The file
    is scanned once when opened, to count messages, and never held in memory.

    Raises
    ------
    SourceError
        If it is no mcap file, or nothing of it can be read.

    """

    def __init__(self, path: Path, limits: RecordingLimits) -> None:
        self.path, self._limits = path, limits
        self.topics: dict[str, Topic] = {}
        self._broken_at, self._largest = -1, 0
        times_ns: list[int] = []
        for message, topic in self._scan():
            times_ns = [*times_ns[:1], message.log_time_ns]
            count = self.topics[topic].count if topic in self.topics else 0
            self.topics[topic] = Topic(topic, message.type_name, count + 1)
        self.duration_s = max(0, times_ns[-1] - times_ns[0]) / 1e9 if times_ns else 0.0
        size = path.stat().st_size
        largest_mb = self._largest / 1e6
        what = f'; a chunk of {largest_mb:.4g} MB'
        too_large = limits.reading.above('max_file_mb', largest_mb, what)
        if not self.topics:
            remedy = too_large or '; record again'
            raise SourceError(f'{path}: no whole message in its {size} bytes of mcap{remedy}')
        self.damage = (
            f'{path}: cut short or damaged at byte {self._broken_at} of {size}'
            if self._broken_at >= 0
            else f'{path}: its index cannot be used, so it was read from start to end'
        )
        self.damage += too_large

    def messages(self, topic: str) -> Iterator[RawMessage]:
        """Yield the messages of a topic in the order in which they lie in the file."""
        return (message for message, name in self._scan() if name == topic)

    def _scan(self) -> Iterator[tuple[RawMessage, str]]:
        from mcap.records import Channel, Message, Schema

        types: dict[int, str] = {}
        channels: dict[int, tuple[str, str]] = {}
        for record in self._records():
            if isinstance(record, Schema):
                types[record.id] = record.name
            elif isinstance(record, Channel) and record.message_encoding == 'cdr':
                channels[record.id] = (record.topic, types.get(record.schema_id, ''))
            elif isinstance(record, Message) and record.channel_id in channels:
                topic, type_name = channels[record.channel_id]
                yield RawMessage(record.log_time, type_name, record.data), topic

    def _records(self) -> Iterator[Any]:
        try:
            from mcap.stream_reader import StreamReader
        except ImportError:
            raise SourceError(
                f'{self.path}: damaged, and mcap, which could save its messages, is not '
                f'installed; {pip_install("mcap")}'
            ) from None
        from mcap.records import Chunk

        refuse_irregular(self.path)
        try:
            with self.path.open('rb') as file:
                if file.read(len(MAGIC)) != MAGIC:
                    raise SourceError(
                        f'{self.path}: not an mcap file; check that it is the recording'
                    )
                data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise SourceError(f'{self.path}: {error.strerror}; check its permissions') from None
        with data:
            inflated, at = 0, len(MAGIC)
            while at < len(data):
                start, opcode = at, data[at : at + 1]
                length = int.from_bytes(data[at + 1 : at + _RECORD_HEAD_BYTES], 'little')
                at += _RECORD_HEAD_BYTES + length
                if opcode == _FOOTER and data[at:] == MAGIC:
                    return
                if opcode == _NONE or at > len(data):
                    self._broken_at = start
                    yield from self._records_of_cut_chunk(data, start)
                    return
                if opcode not in _READ:
                    continue
                if opcode == _CHUNK:
                    declared = _declared_size(data, start)
                    inflated += declared
                    self._limits.refuse_bomb(self.path, inflated, len(data))
                    length = max(length, declared)
                if length > self._limits.chunk_bytes:
                    self._broken_at, self._largest = start, max(self._largest, length)
                    continue
                try:
                    record = next(StreamReader(BytesIO(data[start:at]), True, True).records)
                except Exception:
                    self._broken_at = start
                    yield from self._records_of_cut_chunk(data, start)
                    return
                if not isinstance(record, Chunk):
                    yield record
                    continue
                try:
                    yield from _records_of_chunk(record, self._limits.chunk_bytes)
                except SourceError:
                    self._broken_at = start
            if self._broken_at < 0:
                self._broken_at = len(data)

    def _records_of_cut_chunk(self, data: mmap.mmap, start: int) -> Iterator[Any]:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Chunk

        size = len(data) - start
        if data[start : start + 1] != _CHUNK:
            return
        if size > self._limits.chunk_bytes:
            self._largest = max(self._largest, size)
            return
        try:
            data.seek(start + _RECORD_HEAD_BYTES)
            chunk = Chunk.read(ReadDataStream(data))  # type: ignore[arg-type]
            yield from _records_of_chunk(chunk, self._limits.chunk_bytes)
        except Exception:
            return


def _declared_size(data: mmap.mmap, start: int) -> int:
    """Return what the chunk that starts there declares to hold, bytes."""
    at = start + _RECORD_HEAD_BYTES + _CHUNK_TIMES_BYTES
    return int.from_bytes(data[at : at + 8], 'little')


def _records_of_chunk(chunk: Any, most_bytes: int) -> Iterator[Any]:
    from mcap.stream_reader import StreamReader

    try:
        declared = min(chunk.uncompressed_size, most_bytes)
        content = inflate(chunk.data, chunk.compression, declared)
        content = content[: end_of_records(content, len(chunk.data))]
    except SourceError:
        raise
    except Exception:
        return
    records = iter(StreamReader(BytesIO(content), skip_magic=True).records)
    while True:
        try:
            yield next(records)
        except Exception:
            return
