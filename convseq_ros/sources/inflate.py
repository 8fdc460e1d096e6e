# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Taking compressed data apart without taking more memory than they declare."""

from bz2 import BZ2Decompressor
from collections.abc import Callable
from dataclasses import dataclass
import importlib
from pathlib import Path
from typing import Any

from convseq_ros.errors import SourceError
from convseq_ros.reading_config import ReadingConfig

_MEGA = 1_000_000


@dataclass(frozen=True, slots=True)
class RecordingLimits:
    """What no recording needs; a file that declares more was made to harm, or is damaged."""

    # rosbag2 fills chunks to 768 KiB, Foxglove's tools to 4 MiB; then comes one message more,
    # which is at most an image of 64 Mpx in four bytes a pixel.
    reading: ReadingConfig = ReadingConfig()
    # Images shrink to a third, drawn ones to a fiftieth; zeros to a thirty-thousandth.
    ratio: int = 1000

    @property
    def chunk_bytes(self) -> int:
        """Return what one chunk may hold; those that overlap in time may twice as much."""
        return round(self.reading.max_file_mb * _MEGA)

    @property
    def harmless_bytes(self) -> int:
        """Return what is no bomb if it is all, whatever its ratio."""
        return 4 * self.chunk_bytes

    def refuse_bomb(self, where: object, inflated: int, size: int) -> None:
        """Raise a SourceError if that many bytes are out of all proportion to a file's size."""
        if inflated > self.ratio * size:
            what = f'its {size} bytes inflate to {inflated / 1e9:.3g} GB, which no recording does'
            fourth_mb = inflated / 4 / _MEGA
            self.reading.refuse_above('max_file_mb', fourth_mb, f'{where}: {what}; a fourth')


def inflate(data: bytes, compression: str, most_bytes: int) -> bytes:
    """
    Return what a whole compressed stream holds; of what is cut, as much as there is.

    `compression` is 'zstd', 'lz4', 'bz2', or '' for none. SourceError if it holds more than
    `most_bytes`; what the library of the compression raises, if it is damaged.
    """
    if compression not in _INFLATERS:
        raise SourceError(f'compression {compression!r} is unknown; expected zstd or lz4')
    content = _INFLATERS[compression](data, most_bytes + 1)
    if len(content) > most_bytes:
        raise SourceError(
            f'{len(data)} bytes hold more than the {most_bytes} that they declare, or that '
            'max_file_mb allows; raise it if there is memory'
        )
    return content


def end_of_records(content: bytes, packed_bytes: int) -> int:
    """
    Return where the whole records of an mcap chunk, inflated and perhaps cut, end.

    SourceError if there are more records than the `packed_bytes` of its file can tell apart: to
    walk them would take hours.
    """
    at, left = 0, _FEW_RECORDS + packed_bytes // _LEAST_BYTES
    while at + _HEAD_BYTES <= len(content):
        length = int.from_bytes(content[at + 1 : at + _HEAD_BYTES], 'little')
        opcode, end = content[at], at + _HEAD_BYTES + length
        known = opcode >= _PRIVATE or (opcode in _IN_CHUNKS and length >= _SHORTEST_BYTES)
        if not known or end > len(content):
            break
        at, left = end, left - 1
        if left < 0:
            raise SourceError(f'more records than a chunk of {packed_bytes} bytes can hold')
    return at


def inflated_size(path: Path, most_bytes: int) -> int:
    """Return how much a file compressed with zstd holds, or something above `most_bytes`."""
    import zstandard

    size = 0
    with path.open('rb') as file:
        for piece in zstandard.ZstdDecompressor().read_to_iter(file):
            size += len(piece)
            if size > most_bytes:
                break
    return size


def _zstd(data: bytes, most_bytes: int) -> bytes:
    import zstandard

    reader = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True)
    pieces, left = [], most_bytes
    while left and (piece := reader.read(min(left, _PIECE_BYTES))):
        pieces.append(piece)
        left -= len(piece)
    return b''.join(pieces)


def _lz4(data: bytes, most_bytes: int) -> bytes:
    frame: Any = importlib.import_module('lz4.frame')
    return bytes(frame.LZ4FrameDecompressor().decompress(data, most_bytes))


_PIECE_BYTES = 1 << 20
# The mcap specification: opcode and length; schema, channel and message alone lie in chunks, and
# whatever is private.
_HEAD_BYTES, _IN_CHUNKS, _PRIVATE = 9, (3, 4, 5), 0x80
_SHORTEST_BYTES = 14  # ibid.: a schema, all of whose texts are empty
_FEW_RECORDS, _LEAST_BYTES = 100, 2  # two stamps and a number differ from message to message
_INFLATERS: dict[str, Callable[[bytes, int], bytes]] = {
    '': lambda data, _: data,
    'none': lambda data, _: data,
    'bz2': lambda data, most_bytes: BZ2Decompressor().decompress(data, most_bytes),
    'lz4': _lz4,
    'zstd': _zstd,
}
