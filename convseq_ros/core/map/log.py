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
from pathlib import Path
import struct
from typing import NamedTuple

from convseq_ros.core.map.format import PAGE_BYTES
from convseq_ros.errors import MapError
import numpy as np
import numpy.typing as npt

_HEAD, _FRAME = struct.Struct('>8I'), struct.Struct('>6I')
_MAGIC = 0x377F0682  # the last bit tells the order of the bytes that are summed
_WORDS = 0xFFFFFFFF
_SUMMED = 8  # bytes of a frame's head that are summed, before its page

Words = npt.NDArray[np.uint32]


class _Weights(NamedTuple):
    """What each word adds to both sums, shape (words,), and what sums from before add."""

    first: Words
    second: Words
    before: tuple[int, int, int, int]


def refuse_damaged_log(log: Path) -> None:
    """Raise MapError if what was committed to a map's log is not there any more."""
    try:
        data = log.read_bytes()
    except FileNotFoundError:
        return
    if len(data) > _HEAD.size + PAGE_BYTES and (at := _damaged_at(data)) >= 0:
        raise MapError(
            f'{log}: damaged at byte {at}; it holds what was added to the map last: restore it, '
            'or delete it to go on without'
        )


def _damaged_at(data: bytes) -> int:
    """Return where damage begins; -1 if there is none, or nothing that was safe."""
    magic, _, page_bytes, _, *salts, first, second = _HEAD.unpack_from(data)
    sums = first, second
    if magic & ~1 != _MAGIC or _sums(data[:24], '<>'[magic & 1], (0, 0)) != sums:
        return 0  # it is safe before anything follows it
    order, size = '<>'[magic & 1], _FRAME.size + page_bytes
    frames = range(_HEAD.size, len(data) - size + 1, size)
    for at in frames:
        _, _, *own, first, second = _FRAME.unpack_from(data, at)
        content = data[at : at + _SUMMED] + data[at + _FRAME.size : at + size]
        found = _sums(content, order, sums)
        if own == salts and found == (first, second):
            sums = found
            continue
        flipped = sum((a ^ b).bit_count() for a, b in zip(own, salts, strict=True))
        if flipped == 1 and found == (first, second):
            return at
        if not flipped and _is_one_bit(content, order, sums, (first, second)):
            return at
        later = (_FRAME.unpack_from(data, one) for one in frames if one >= at)
        commits = sum(bool(pages) and own == salts for _, pages, *own, _, _ in later)
        return at if commits > 1 else -1
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
