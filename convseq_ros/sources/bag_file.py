# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A .bag of ROS 1, read by rosbags, with limits on memory and time for damaged files."""

from collections.abc import Iterator
import functools
from pathlib import Path
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import SourceError
from convseq_ros.sources.inflate import inflate
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topics import Index, Topic, typestore

_MAGIC = b'#ROSBAG V2.0\n'


def index(path: Path, reading: ReadingConfig) -> Index:
    with _opened(path, reading) as reader:
        topics = {
            name: Topic(name, info.msgtype or 'several types', int(info.msgcount))
            for name, info in reader.topics.items()
        }
        return Index(topics, int(reader.start_time), int(reader.end_time))


def messages(
    path: Path, reading: ReadingConfig, topic: str, _report: Any = None
) -> Iterator[RawMessage]:
    """Yield the messages of a topic in order of recording; a damaged one has no content."""
    with _opened(path, reading) as reader:
        chosen = [item for item in reader.connections if item.topic == topic]
        for connection, log_time_ns, data in reader.messages(chosen) if chosen else ():
            try:
                cdr = bytes(typestore().ros1_to_cdr(data, connection.msgtype))
            except Exception:
                cdr = b''
            yield RawMessage(log_time_ns, connection.msgtype, cdr)


def _opened(path: Path, reading: ReadingConfig) -> Any:
    with path.open('rb') as file:
        # Without this check, rosbags searches the whole file for the end of the first line.
        if file.read(len(_MAGIC)) != _MAGIC:
            raise SourceError('it does not begin as a recording does')
    return _bounded_reader()(path, reading)


@functools.cache
def _bounded_reader() -> type:
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import decompressors

    names = {function: name for name, function in decompressors.items()}

    class BoundedBag(Reader):
        """A .bag with limits on the bytes of its index and of its chunks."""

        _indexed_bytes = _inflated_bytes = 0

        def __init__(self, path: Path, reading: ReadingConfig) -> None:
            super().__init__(path)
            self._reading, self._size = reading, path.stat().st_size

        def read_index_data(self, pos: int, indexes: Any) -> None:
            """Read a chunk's index; ValueError if indexes are larger than the file in total."""
            assert self.bio
            start = self.bio.tell()
            super().read_index_data(pos, indexes)
            self._indexed_bytes += self.bio.tell() - start
            if self._indexed_bytes > self._size:
                raise ValueError('its index lists a chunk more than once')

        def read_chunk(self) -> Any:
            chunk = super().read_chunk()

            def bounded(data: bytes) -> bytes:
                content = inflate(data, names[chunk.decompressor], self._reading.most_bytes)
                # Only one chunk is cached: alternating messages inflate their chunks each time.
                self._inflated_bytes += len(content)
                self._reading.refuse_bomb('it', self._inflated_bytes, self._size)
                return content

            return chunk._replace(decompressor=bounded)

    return BoundedBag
