# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decompresses data without using more memory than they declare, or than is allowed."""

from bz2 import BZ2Decompressor
from collections.abc import Iterator
from contextlib import contextmanager
import importlib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import SourceError

ZSTD_START = b'\x28\xb5\x2f\xfd'


def inflate(data: bytes, compression: str, most_bytes: int) -> bytes:
    """
    Return the content of a compressed stream; if it is cut short, as much as there is.

    `compression` is 'zstd', 'lz4', 'bz2', or '' or 'none'. SourceError if the content is larger
    than `most_bytes`; an error of the compression's library if the stream is damaged.
    """
    if compression in ('', 'none'):
        content = data
    elif compression == 'bz2':
        content = BZ2Decompressor().decompress(data, most_bytes + 1)
    elif compression == 'lz4':
        lz4: Any = importlib.import_module('lz4.frame')
        content = bytes(lz4.LZ4FrameDecompressor().decompress(data, most_bytes + 1))
    elif compression == 'zstd':
        import zstandard

        packed = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True)
        content = packed.read(most_bytes + 1)
    else:
        raise SourceError(f'compression {compression!r} is unknown; expected zstd or lz4')
    if len(content) > most_bytes:
        raise SourceError(
            f'{len(data)} bytes hold more than the {most_bytes} that they declare, or that '
            'max_file_mb allows; raise it if there is memory'
        )
    return content


@contextmanager
def inflated_file(path: Path, reading: ReadingConfig) -> Iterator[Path]:
    """Yield a decompressed copy of a `.zstd` file; any other file as it is."""
    if path.suffix.lower() != '.zstd':
        yield path
        return
    import zstandard

    size, inflated = path.stat().st_size, 0
    with TemporaryDirectory(prefix='convseq_') as folder:
        plain = Path(folder, path.stem)
        with path.open('rb') as packed, plain.open('wb') as file:
            for piece in zstandard.ZstdDecompressor().read_to_iter(packed):
                inflated += len(piece)
                reading.refuse_bomb(path, inflated, size)
                file.write(piece)
        yield plain
