# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Flips a bit in the chunks of an mcap, which only their checksums tell."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
import random
from typing import Any

from convseq_ros.errors import SourceError
from convseq_ros.sources import open_source
from mcap.reader import make_reader
from mcap.writer import CompressionType
import numpy as np

from bench.torture import corpus
from bench.torture.attack import Try

ABOUT = 'In an mcap of 12 images, plain, of lz4 or of zstd, one bit of a chunk flips; it is read'
ORACLE = 'every frame is one that was written; those that are not there are told in one line'
COUNT, PORTION, SHORT, SEED = 2_000, 500, 60, 16
_IMAGES, _STEP_NS = 12, 100_000_000
_TOPIC = '/image'


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Flip bits of recordings."""
    draw = random.Random(seed)
    stamps_ns = [(number + 1) * _STEP_NS for number in range(_IMAGES)]
    rows = [(_TOPIC, at, _image(number, at)) for number, at in enumerate(stamps_ns)]
    whole = []
    for kind in (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD):
        path = corpus.write_mcap(folder / f'{kind.name}.mcap', rows, kind)
        whole.append((path.read_bytes(), _chunks(path)))
    path = folder / 'flipped.mcap'
    for number in range(count):
        content, chunks = draw.choice(whole)
        start, end = draw.choice(chunks)
        damaged, position = bytearray(content), draw.randrange(start, end)
        damaged[position] ^= 1 << draw.randrange(8)
        path.write_bytes(damaged)
        yield Try(f'{number}: flip at {position} of {len(content)}', _problem(path, stamps_ns))


def _image(number: int, stamp_ns: int) -> Any:
    message = corpus.message(corpus.IMAGE, number)
    stamp = corpus.ROS2.types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    return replace(message, header=replace(message.header, stamp=stamp))


def _chunks(path: Path) -> list[tuple[int, int]]:
    with path.open('rb') as file:
        summary = make_reader(file).get_summary()
    assert summary
    starts = [(one.chunk_start_offset, one.chunk_length) for one in summary.chunk_indexes]
    return [(start, start + length) for start, length in starts]


def _problem(path: Path, stamps_ns: list[int]) -> str:
    """Read a damaged recording; return what is wrong with its frames."""
    try:
        source = open_source(path)
        frames = list(source)
    except SourceError as error:
        return '' if '\n' not in str(error) else f'{error!r}'
    for frame in frames:
        if frame.stamp_ns not in stamps_ns:
            return f'a frame of {frame.stamp_ns} ns'
        gray = corpus.gray(stamps_ns.index(frame.stamp_ns))
        if frame.gray is None or not np.array_equal(frame.gray, gray):
            return f'the frame of {frame.stamp_ns} ns is another'
    if len(frames) < _IMAGES and len(source.warnings) != 1:
        return f'{len(frames)} frames, told in {source.warnings}'
    return ''
