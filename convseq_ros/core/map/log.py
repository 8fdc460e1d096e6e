# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
SQLite's log beside a map, which a crash leaves: whether what was committed to it is still there.

SQLite reads a log up to the first page that fails its checksum, and passes over the rest without
a word: so it must, for a power cut may leave half a commit. What is damaged later is told apart
here: one flipped bit explains the checksum, or further commits follow, and each is made after the
one before is safe.
The format is that of https://sqlite.org/fileformat2.html, section 4.
"""

from contextlib import suppress
from functools import cache
import os
from pathlib import Path
import struct
from typing import BinaryIO, NamedTuple

from convseq_ros.core.map.format import PAGE_BYTES
from convseq_ros.errors import MapError
import numpy as np
import numpy.typing as npt

_HEAD, _FRAME = struct.Struct('>8I'), struct.Struct('>6I')
_MAGIC = 0x377F0682  # the last bit tells the order of the bytes that are summed
_WORDS = 0xFFFFFFFF
_SUMMED_OF_HEAD = 24  # bytes
_SUMMED = 8  # bytes of a frame's head that are summed, before its page
_PAGES = frozenset(1 << power for power in range(9, 17))  # bytes that a page may have

Words = npt.NDArray[np.uint32]


class _Weights(NamedTuple):
    """What each word adds to both sums, shape (words,), and what sums from before add."""

    first: Words
    second: Words
    before: tuple[int, int, int, int]


def refuse_damaged_log(log: Path) -> None:
    """Raise MapError if what was committed to a map's log is not there any more."""
    at = -1
    with suppress(OSError):  # SQLite says what is wrong
        if log.is_file():
            with log.open('rb') as file:
                at = _damaged_at(file)
    if at >= 0:
        raise MapError(
            f'{log}: damaged at byte {at}; it holds what was added to the map last: restore it, '
            'or delete it to go on without'
        )


def _damaged_at(file: BinaryIO) -> int:
    """Return where damage begins; -1 if there is none, or nothing that was safe."""
    if os.fstat(file.fileno()).st_size <= _HEAD.size + PAGE_BYTES:
        return -1  # nothing was safe
    head, at = file.read(_HEAD.size), _HEAD.size
    magic, _, page_bytes, _, *salts, first, second = _HEAD.unpack(head)
    sums, order = (first, second), '<>'[magic & 1]
    if magic & ~1 != _MAGIC or _sums(head[:_SUMMED_OF_HEAD], order, (0, 0)) != sums:
        return 0  # it is safe before anything follows it
    if page_bytes not in _PAGES:
        return 0
    damaged_at, commits, size = -1, 0, _FRAME.size + page_bytes
    while len(frame := file.read(size)) == size:
        _, pages, *own, first, second = _FRAME.unpack_from(frame)
        if damaged_at < 0:
            content = frame[:_SUMMED] + frame[_FRAME.size :]
            found = _sums(content, order, sums)
            if own == salts and found == (first, second):
                sums = found
            else:
                flipped = sum((a ^ b).bit_count() for a, b in zip(own, salts, strict=True))
                if flipped == 1 and found == (first, second):
                    return at
                if not flipped and _is_one_bit(content, order, sums, (first, second)):
                    return at
                damaged_at = at
        # One commit may be half written; before a second one the first was safe.
        commits += damaged_at >= 0 and bool(pages) and own == salts
        if commits > 1:
            return damaged_at
        at += size
    return -1


def _sums(content: bytes, order: str, before: tuple[int, int]) -> tuple[int, int]:
    """Return the sums of some bytes, going on from those before."""
    words, weights = np.frombuffer(content, f'{order}u4'), _weights(len(content) // 4)
    a, b, c, d = weights.before
    first = a * before[0] + b * before[1] + int((words * weights.first).sum(dtype=np.uint32))
    second = c * before[0] + d * before[1] + int((words * weights.second).sum(dtype=np.uint32))
    return first & _WORDS, second & _WORDS


def _is_one_bit(
    content: bytes, order: str, before: tuple[int, int], stored: tuple[int, int]
) -> bool:
    """Tell whether one flipped bit, of what is summed or of the sums, makes them differ."""
    found = _sums(content, order, before)
    if sum((one ^ other).bit_count() for one, other in zip(found, stored, strict=True)) == 1:
        return True
    weights = _weights(len(content) // 4)
    for sign in (1, -1):
        first, second = (
            np.uint32(sign * (one - other) & _WORDS)
            for one, other in zip(found, stored, strict=True)
        )
        for bit in np.arange(32, dtype=np.uint32):
            if np.any((weights.first << bit == first) & (weights.second << bit == second)):
                return True
    return False


@cache
def _weights(count: int) -> _Weights:
    # Of two words x, y: first += x + second; second += y + first.
    pairs, a, b, c, d = [], 1, 0, 0, 1  # the power of [[1, 1], [1, 2]] so far
    for _ in range(count // 2):
        pairs.append(((a + b, b), (c + d, d)))
        a, b, c, d = (one & _WORDS for one in (a + b, a + 2 * b, c + d, c + 2 * d))
    both = np.array(pairs[::-1], np.uint64).astype(np.uint32).transpose(1, 0, 2)
    return _Weights(both[0].ravel(), both[1].ravel(), (a, b, c, d))
