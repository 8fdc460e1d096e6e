# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A .bag of ROS 1, read by rosbags, with a limit on the memory of its chunks."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
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


@contextmanager
def _opened(path: Path, reading: ReadingConfig) -> Iterator[Any]:
    # AnyReader makes code of the message definitions in a file; this one does not.
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import decompressors

    with path.open('rb') as file:
        # Without this check, rosbags searches the whole file for the end of the first line.
        if file.read(len(_MAGIC)) != _MAGIC:
            raise SourceError('it does not begin as a recording does')
    names = {function: name for name, function in decompressors.items()}
    with Reader(path) as reader:
        for at, chunk in reader.chunks.items():
            name, most = names[chunk.decompressor], reading.most_bytes
            bounded = partial(inflate, compression=name, most_bytes=most)
            reader.chunks[at] = chunk._replace(decompressor=bounded)
        yield reader
