# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damages files like a bad disk: a map, the log of a growing map."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
import random
from typing import NamedTuple

from convseq_ros.core.map.format import PAGE_BYTES
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map.writer import save_map

from bench.torture.attack import Try
from bench.torture.maps import add_one, answers, crash, drawn, links_hold, log_of, problem_of_use

_SECTOR = 512
_LOG_FRAME, _LOG_HEAD = PAGE_BYTES + 24, 24  # of a log: a page with its header


class Sample(NamedTuple):
    """A file that is damaged, and what must hold then."""

    path: Path
    problem: Callable[[range], str]  # by the bytes that are damaged


def map_damage(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Damage a map of 60 places and 40 links."""
    path = folder / 'map.db'
    save_map(drawn(60), path)
    whole, links = answers(path), len(open_map(path).links)

    def used() -> str:
        if answers(path) != whole:
            return 'answers otherwise'
        opened = open_map(path)
        if not links_hold(opened) or (len(opened.links) < links and not opened.problem):
            return f'has {len(opened.links)} links, and says {opened.problem!r}'
        return add_one(path, 60)

    sample = Sample(path, lambda _: problem_of_use(path, used))
    kinds = *6 * ['flip'], 'zeros', *2 * ['elsewhere'], 'cut'
    return _damaged([sample], kinds, count, random.Random(seed))


def log_damage(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Damage logs of maps after a crash, with one to six commits that are in the log alone."""
    draw = random.Random(seed)
    samples = [_log(folder / f'{commits}.db', commits, draw) for commits in range(1, 7)]
    return _damaged(samples, (*9 * ['flip'], 'zeros'), count, draw)


def _damaged(
    samples: list[Sample], kinds: Sequence[str], count: int, draw: random.Random
) -> Iterator[Try]:
    """Damage one of the samples in one of the ways, and use it, again and again."""
    folder = samples[0].path.parent
    files = {path: path.read_bytes() for path in folder.iterdir()}
    for number in range(count):
        (path, problem), kind = draw.choice(samples), draw.choice(kinds)
        span, content = _damage(files[path], kind, draw)
        for one in folder.iterdir():
            one.unlink()
        for one, whole in files.items():
            one.write_bytes(whole if one != path else content)
        yield Try(f'{number}: {kind} of {path.name} at {span.start}', problem(span))


def _damage(content: bytes, kind: str, draw: random.Random) -> tuple[range, bytes | bytearray]:
    """Return which bytes are damaged, and all of them."""
    new, at = bytearray(content), draw.randrange(len(content))
    if kind == 'flip':
        new[at] ^= 1 << draw.randrange(8)
        return range(at, at + 1), new
    if kind == 'cut':
        return range(at, len(content)), content[:at]
    at -= at % _SECTOR
    other = draw.randrange(len(content) // _SECTOR) * _SECTOR
    sector = content[other : other + _SECTOR] if kind == 'elsewhere' else bytes(_SECTOR)
    new[at : at + _SECTOR] = sector[: len(content) - at]
    return range(at, at + _SECTOR), new


def _log(path: Path, commits: int, draw: random.Random) -> Sample:
    counts = [8]
    for _ in range(commits):
        counts.append(counts[-1] + draw.randint(1, 6))
    ends, log = crash(path, *counts), log_of(path)
    whole = log.read_bytes()

    def used(allowed: set[int]) -> str:
        if (count := len(MapReader(path))) not in allowed:
            return f'has {count} places, not {sorted(allowed)}'
        return add_one(path, count)

    def problem(span: range) -> str:
        allowed, safe = {counts[-1]}, sum(end <= span.start for end in ends)
        marks = [end - _LOG_FRAME for end in ends[safe:]]
        after = [at for at in marks if not span.start - _LOG_HEAD < at < span.start + _SECTOR]
        if len(after) <= 1:
            allowed.add(counts[safe])
        is_damaged = log.read_bytes() != whole
        return problem_of_use(path, partial(used, allowed), may_refuse=is_damaged)

    return Sample(log, problem)
