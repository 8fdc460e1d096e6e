# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damages files like a bad disk: a map, the log of a growing map, a recording."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
import random
from typing import Any

from convseq_ros.core.map.format import PAGE_BYTES
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map.writer import MapWriter, save_map
from convseq_ros.errors import SourceError
from convseq_ros.sources import open_source
from mcap.reader import make_reader
from mcap.writer import CompressionType
import numpy as np

from bench.torture import corpus
from bench.torture.attack import Attack, Try
from bench.torture.maps import add_one, APART, drawn, ENCODING, links_hold, problem_of_use

_SECTOR = 512
_LOG_FRAME, _LOG_HEAD = PAGE_BYTES + 24, 24  # of a log: a page with its header
_IMAGES, _STEP_NS = 12, 100_000_000


@dataclass(frozen=True, slots=True)
class Sample:
    """Whole files by name, of which the last is damaged, and what must hold then."""

    files: dict[str, bytes]
    problem: Callable[[Path, range], str]  # of the first file, by the bytes that are damaged
    spans: list[range]  # of the last file: where it is damaged

    def damaged(self, kind: str, draw: random.Random) -> tuple[range, bytes]:
        """Return which bytes of the last file are damaged, and that file."""
        content = [*self.files.values()][-1]
        new, span = bytearray(content), draw.choice(self.spans)
        at = draw.randrange(span.start, span.stop)
        if kind == 'flip':
            new[at] ^= 1 << draw.randrange(8)
            return range(at, at + 1), bytes(new)
        if kind == 'cut':
            return range(at, len(content)), content[:at]
        at -= at % _SECTOR
        other = draw.randrange(len(content) // _SECTOR) * _SECTOR
        new[at : at + _SECTOR] = (bytes(len(content)) if kind == 'zeros' else content)[
            other : other + _SECTOR
        ]
        return range(at, at + _SECTOR), bytes(new)


def _run(
    samples: Callable[[Path, random.Random], list[Sample]],
    kinds: str,
    count: int,
    seed: int,
    folder: Path,
) -> Iterator[Try]:
    """Damage one of the samples in one of the ways, and use it, again and again."""
    draw = random.Random(seed)
    known = samples(folder, draw)
    for number in range(count):
        _clear(folder)
        sample, kind = draw.choice(known), draw.choice(kinds.split())
        span, damaged = sample.damaged(kind, draw)
        first, *_, last = [folder / name for name in (*sample.files, *sample.files)]
        for name, content in sample.files.items():
            (folder / name).write_bytes(content)
        last.write_bytes(damaged)
        yield Try(f'{number}: {kind} of {last.name} at {span.start}', sample.problem(first, span))


def _clear(folder: Path) -> None:
    for one in folder.iterdir():
        one.unlink()


def _map(folder: Path, _draw: random.Random) -> list[Sample]:
    """Return a map of 60 places and 40 links."""
    path = folder / 'map.db'
    save_map(drawn(60), path)
    content, answers, links = path.read_bytes(), _answers(path), len(open_map(path).links)

    def used(path: Path) -> str:
        if _answers(path) != answers:
            return 'answers otherwise'
        opened = open_map(path)
        if not links_hold(opened) or (len(opened.links) < links and not opened.problem):
            return f'has {len(opened.links)} links, and says {opened.problem!r}'
        return add_one(path, 60)

    def problem(path: Path, _span: range) -> str:
        return problem_of_use(path, partial(used, path))

    return [Sample({path.name: content}, problem, [range(len(content))])]


def _answers(path: Path) -> object:
    """Return all answers of a map, in a form that can be compared."""
    reader = MapReader(path)
    opened = reader.reference_map()
    pictures = opened.pictures(range(len(opened)), with_images=True)
    shown = [(one.packed.tobytes(), one.thumbnail, one.image) for one in pictures]
    vectors = opened.global_descriptors.tobytes()
    return reader.settings, opened.sessions, [*opened.places], vectors, shown


def _logs(folder: Path, draw: random.Random) -> list[Sample]:
    """Return maps after a crash, with one to six commits that are in their logs alone."""
    return [_log(folder / 'map.db', commits, draw) for commits in range(1, 7)]


def _log(path: Path, commits: int, draw: random.Random) -> Sample:
    log, counts, ends = path.with_name('map.db-wal'), [8], list[int]()
    _clear(path.parent)
    save_map(drawn(counts[0]), path)
    with MapWriter(path, ENCODING, APART, append=True) as writer:
        writer.write_ahead()
        for _ in range(commits):
            counts.append(counts[-1] + draw.randint(1, 6))
            writer.copy(drawn(counts[-1]), counts[-1])
            ends.append(log.stat().st_size)
        files = {path.name: path.read_bytes(), log.name: log.read_bytes()}

    def used(path: Path, allowed: set[int]) -> str:
        if (count := len(MapReader(path))) not in allowed:
            return f'has {count} places, not {sorted(allowed)}'
        return add_one(path, count)

    def problem(path: Path, span: range) -> str:
        allowed, safe = {counts[-1]}, sum(end <= span.start for end in ends)
        marks = [end - _LOG_FRAME for end in ends[safe:]]
        whole = [at for at in marks if not span.start - _LOG_HEAD < at < span.start + _SECTOR]
        if len(whole) <= 1:
            allowed.add(counts[safe])
        is_damaged = path.with_name(log.name).read_bytes() != files[log.name]
        return problem_of_use(path, partial(used, path, allowed), may_refuse=is_damaged)

    return Sample(files, problem, [range(len(files[log.name]))])


def _recordings(folder: Path, _draw: random.Random) -> list[Sample]:
    """Return recordings of 12 images, plain, of lz4 and of zstd."""
    stamps_ns = [(number + 1) * _STEP_NS for number in range(_IMAGES)]
    rows = [('/image', at, _image(number, at)) for number, at in enumerate(stamps_ns)]
    samples = []
    for kind in (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD):
        path = corpus.write_mcap(folder / f'{kind.name}.mcap', rows, kind)
        with path.open('rb') as file:
            summary = make_reader(file).get_summary()
        assert summary
        starts = [(one.chunk_start_offset, one.chunk_length) for one in summary.chunk_indexes]
        chunks = [range(start, start + length) for start, length in starts]
        read = partial(_frames_problem, stamps_ns)
        samples.append(Sample({path.name: path.read_bytes()}, read, chunks))
    return samples


def _image(number: int, stamp_ns: int) -> Any:
    message = corpus.message(corpus.IMAGE, number)
    stamp = corpus.ROS2.types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    return replace(message, header=replace(message.header, stamp=stamp))


def _frames_problem(stamps_ns: list[int], path: Path, _span: range) -> str:
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


ATTACKS = {
    'map_damage': Attack(
        'In a map of 60 places and 40 links one bit flips (of ten tries six), 512 bytes are zeros'
        ' or those of elsewhere (three), or the end is cut off (one); it is read, and added to',
        'it is refused with one line within 5 s, or all that it answers is what it was, but for '
        'links that it says in one line are damaged',
        5_000, 500, 40, partial(_run, _map, 'flip ' * 6 + 'zeros elsewhere elsewhere cut'),
    ),
    'log_damage': Attack(
        'A map grows in one to six commits and crashes, none of them in its file yet; one bit of '
        'the log flips (of ten tries nine), or 512 bytes of it are zeros; it is read, and added '
        'to',
        'it is refused with one line within 5 s, or has all that was committed; what a power cut '
        'may leave too, damage with at most one whole commit after it, costs what follows it',
        2_000, 500, 30, partial(_run, _logs, 'flip ' * 9 + 'zeros'),
    ),
    'recording_damage': Attack(
        'In an mcap of 12 images, plain, of lz4 or of zstd, one bit of a chunk flips; it is read',
        'every frame is one that was written; those that are not there are told in one line',
        2_000, 500, 60, partial(_run, _recordings, 'flip'),
    ),
}  # fmt: skip
