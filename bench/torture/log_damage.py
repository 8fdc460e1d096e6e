# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damages the log of a growing map after a crash, like a bad disk."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
import random

from convseq_ros.core.map.format import PAGE_BYTES
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.writer import MapWriter, save_map

from bench.torture.attack import Try
from bench.torture.maps import add_one, APART, drawn, ENCODING, problem_of_use

ABOUT = (
    'A map grows in one to six commits and crashes, none of them in its file yet; one bit of the '
    'log flips (of ten tries nine), or 512 bytes of it are zeros; it is read, and added to'
)
ORACLE = (
    'it is refused with one line within 5 s, or has all that was committed; what a power cut may '
    'leave too, damage with at most one whole commit after it, costs what follows it'
)
COUNT, PORTION, SHORT, SEED = 2_000, 500, 30, 16
_PLACES, _SECTOR = 8, 512
_FRAME, _MARK = PAGE_BYTES + 24, 24  # of the log: a page with its header


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Damage the logs of crashed maps in many ways."""
    draw, path = random.Random(seed), folder / 'map.db'
    crashed = [_crashed(folder, commits, draw) for commits in range(1, 7)]
    for number in range(count):
        content, log, ends, counts = draw.choice(crashed)
        damaged, position = bytearray(log), draw.randrange(len(log))
        is_flip = draw.random() < 0.9
        if is_flip:
            damaged[position] ^= 1 << draw.randrange(8)
        else:
            position -= position % _SECTOR
            damaged[position : position + _SECTOR] = bytes(_SECTOR)
        allowed, safe = {counts[-1]}, sum(end <= position for end in ends)
        marks = [end - _FRAME for end in ends[safe:]]
        left = [at for at in marks if not position - _MARK < at < position + _SECTOR]
        if len(left) <= 1:
            allowed.add(counts[safe])
        _clear(folder)
        path.write_bytes(content)
        path.with_name('map.db-wal').write_bytes(damaged)
        name = f'{number}: {"flip" if is_flip else "zeros"} at {position} of {len(log)}'
        used = partial(_used, path, allowed)
        yield Try(name, problem_of_use(path, used, may_refuse=damaged != log))


def _crashed(
    folder: Path, commits: int, draw: random.Random
) -> tuple[bytes, bytes, list[int], list[int]]:
    """Return a map, its log, the ends of commits in it, and the place counts between them."""
    path = folder / 'map.db'
    log, counts, ends = path.with_name('map.db-wal'), [_PLACES], []
    _clear(folder)
    save_map(drawn(_PLACES), path)
    with MapWriter(path, ENCODING, APART, append=True) as writer:
        writer.write_ahead()
        for _ in range(commits):
            counts.append(counts[-1] + draw.randint(1, 6))
            writer.copy(drawn(counts[-1]), counts[-1])
            ends.append(log.stat().st_size)
        return path.read_bytes(), log.read_bytes(), ends, counts


def _clear(folder: Path) -> None:
    for one in folder.iterdir():
        one.unlink()


def _used(path: Path, allowed: set[int]) -> str:
    if (count := len(MapReader(path))) not in allowed:
        return f'has {count} places, not {sorted(allowed)}'
    return add_one(path, count)
