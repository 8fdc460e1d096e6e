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
_WORDS = 0xFFFFFFFF  # sums are of 32 bits
_SUMMED_OF_HEAD = 24  # bytes
_SUMMED = 8  # bytes of a frame's head that are summed, before its page
_PAGE_BYTES = frozenset(1 << power for power in range(9, 17))  # that SQLite has
_LOOKED_AT = 8192  # frames; 500 places, which are the most in a commit, take some 1,500

Words = npt.NDArray[np.uint32]


class _Weights(NamedTuple):
    """What each word adds to both sums, shape (words,), and what sums from before add."""

    first: Words
    second: Words
    before: tuple[int, int, int, int]


def refuse_damaged_log(log: Path) -> None:
    """Raise MapError if what was committed to a map's log is not there any more."""
    if not log.is_file():  # a pipe would hang
        return
    try:
        with log.open('rb') as file:
            is_large = os.fstat(file.fileno()).st_size > _HEAD.size + PAGE_BYTES
            at = _damaged_at(file) if is_large else -1
    except OSError:
        return  # SQLite says what is wrong
    if at >= 0:
        raise MapError(
            f'{log}: damaged at byte {at}; it holds what was added to the map last: restore it, '
            'or delete it to go on without'
        )


def _damaged_at(log: BinaryIO) -> int:
    """Return where damage begins; -1 if there is none, or nothing that was safe."""
    head = log.read(_HEAD.size)
    magic, _, page_bytes, _, *salts, first, second = _HEAD.unpack(head)
    sums, order = (first, second), '<>'[magic & 1]
    is_head = magic & ~1 == _MAGIC and page_bytes in _PAGE_BYTES
    if not is_head or _sums(head[:_SUMMED_OF_HEAD], order, (0, 0)) != sums:
        return 0  # it is safe before anything follows it
    at, size = _HEAD.size, _FRAME.size + page_bytes
    while len(frame := log.read(size)) == size:
        _, _, *own, first, second = _FRAME.unpack_from(frame)
        content = frame[:_SUMMED] + frame[_FRAME.size :]
        found = _sums(content, order, sums)
        flipped = sum((a ^ b).bit_count() for a, b in zip(own, salts, strict=True))
        if found != (first, second) or flipped:
            is_flip = flipped == 1 and found == (first, second)
            is_flip |= not flipped and _is_one_bit(content, order, sums, (first, second))
            return at if is_flip or _commits(log, at, size, salts) > 1 else -1
        sums, at = found, at + size
    return -1


def _commits(log: BinaryIO, at: int, size: int, salts: list[int]) -> int:
    """Return how many commits of a log end there or later; not all, if they are many."""
    found = 0
    for number in range(_LOOKED_AT):
        log.seek(at + number * size)
        if len(head := log.read(_FRAME.size)) < _FRAME.size or found > 1:
            break
        _, pages, *own, _, _ = _FRAME.unpack(head)
        found += bool(pages) and own == salts
    return found


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
