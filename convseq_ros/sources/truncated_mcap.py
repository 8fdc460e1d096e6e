# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What can be saved of an mcap file without its index, such as a crashed recorder leaves."""

from collections.abc import Iterator
import importlib
from io import BytesIO
import mmap
from pathlib import Path
from typing import Any

from convseq_ros.errors import SourceError
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topics import Topic

MAGIC = b'\x89MCAP0\r\n'
_RECORD_HEAD_BYTES = 9
_CHUNK_OPCODE = 6


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

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, Topic] = {}
        self._broken_at = -1
        for message, topic in self._scan():
            count = self.topics[topic].count if topic in self.topics else 0
            self.topics[topic] = Topic(topic, message.type_name, count + 1)
        size = path.stat().st_size
        if not self.topics:
            raise SourceError(
                f'{path}: no whole message in its {size} bytes of mcap; record again'
            )
        self.damage = (
            f'{path}: cut short or damaged at byte {self._broken_at} of {size}'
            if self._broken_at >= 0
            else f'{path}: its index cannot be used, so it was read from start to end'
        )

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
                'installed; pip install mcap'
            ) from None
        from mcap.records import Chunk

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
            reader = StreamReader(data, emit_chunks=True, record_size_limit=len(data))  # type: ignore[arg-type]
            records = iter(reader.records)
            while True:
                start = data.tell()
                try:
                    record = next(records)
                except StopIteration:
                    return
                except Exception:
                    self._broken_at = start
                    yield from _records_of_cut_chunk(data, start)
                    return
                if isinstance(record, Chunk):
                    yield from _records_of_chunk(record)
                else:
                    yield record


def _records_of_cut_chunk(data: mmap.mmap, start: int) -> Iterator[Any]:
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk

    if data[start : start + 1] != bytes([_CHUNK_OPCODE]):
        return
    try:
        data.seek(start + _RECORD_HEAD_BYTES)
        chunk = Chunk.read(ReadDataStream(data))  # type: ignore[arg-type]
    except Exception:
        return
    yield from _records_of_chunk(chunk)


def _records_of_chunk(chunk: Any) -> Iterator[Any]:
    from mcap.stream_reader import StreamReader

    try:
        content = BytesIO(_decompress(chunk.data, chunk.compression))
    except Exception:
        return
    records = iter(StreamReader(content, skip_magic=True).records)
    while True:
        try:
            yield next(records)
        except Exception:
            return


def _decompress(data: bytes, compression: str) -> bytes:
    """Return as much as a stream, perhaps cut, gives."""
    if compression == 'zstd':
        import zstandard

        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    if compression == 'lz4':
        lz4_frame: Any = importlib.import_module('lz4.frame')
        return bytes(lz4_frame.LZ4FrameDecompressor().decompress(data))
    return data
