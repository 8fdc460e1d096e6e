# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulates power cuts: each write without a sync may or may not be on the disk."""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
import itertools
import os
from pathlib import Path
import random
import shutil
import struct
import tempfile
import traceback

from bench.torture.attack import Try
from bench.torture.disk import Acknowledged, print_tries, recorded, tries_of
from bench.torture.map_writes import SCENARIOS

ABOUT = (
    'The power is cut at a random call of those of `map_writes`: of what was written since a file '
    'was synced last, each 512 bytes are there or not; of the names since their folder was, the '
    'first so many'
)
ORACLE = 'that of `map_writes`'
COUNT, PORTION, SHORT, SEED = 2_000, 200, 16, 16
_SECTOR = 512
_HEAD = struct.Struct('<6q')
_NOT_SYNCED = 'result table'  # may lose the rows of the last second


@dataclass(frozen=True, slots=True)
class Call:
    """A call that changed the disk; `data` is bytes or a second name."""

    what: str
    file: int
    at: int
    acknowledged: int
    name: str
    data: bytes


@dataclass(slots=True)
class Disk:
    """The synced content of a disk, and the pending calls."""

    names: dict[str, int] = field(default_factory=dict)  # folders are -1
    files: dict[int, bytearray] = field(default_factory=dict)
    folders: dict[int, str] = field(default_factory=dict)
    late_names: list[Call] = field(default_factory=list)
    late: dict[int, list[Call]] = field(default_factory=dict)

    def see(self, call: Call) -> None:
        """Add a call."""
        if call.what in 'wt':
            self.late.setdefault(call.file, []).append(call)
        elif call.what != 's':
            self.late_names.append(call)
        elif call.file in self.folders:
            for one in self.late_names:
                self._rename(one)
            self.late_names.clear()
        else:
            for one in self.late.pop(call.file, []):
                self._write(one)

    def cut(self, draw: random.Random) -> None:
        """Apply a random selection of the pending calls, and drop the others."""
        for one in self.late_names[: draw.randint(0, len(self.late_names))]:
            self._rename(one)
        for calls in self.late.values():
            chance = draw.choice((0.0, 0.5, 0.9, 1.0))
            for one in calls:
                self._write(one, draw, chance)

    def _rename(self, call: Call) -> None:
        if call.what == 'o':
            self.names[call.name] = call.file
        elif call.what == 'm':
            self.names[call.name] = -1
        elif call.what == 'u':
            self.names.pop(call.name, None)
        else:
            self.names[call.data.decode()] = self.names.pop(call.name)

    def _write(self, call: Call, draw: random.Random | None = None, chance: float = 1.0) -> None:
        content = self.files.setdefault(call.file, bytearray())
        if call.what == 't':
            if not draw or draw.random() < chance:
                del content[call.at :]
            return
        for start in range(0, len(call.data), _SECTOR):
            if draw and draw.random() >= chance:
                continue
            piece, at = call.data[start : start + _SECTOR], call.at + start
            content.extend(bytes(max(0, at - len(content))))
            content[at : at + len(piece)] = piece


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Run the tries in a program whose disk calls are recorded."""
    yield from tries_of('map_power', count, seed, folder)


def tries(count: int, seed: int, folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the name and the problem of every try."""
    draw = random.Random(seed)
    synced = [name for name in SCENARIOS if name != _NOT_SYNCED]
    made = 0
    while made < count:
        commits = [draw.randint(1, 40) for _ in range(3)]
        for name in synced:
            with tempfile.TemporaryDirectory(dir=folder) as scratch:
                path = Path(scratch, 'map.db')
                start, calls, last = _recorded(name, path, commits, folder)
            for _ in range(min(20, count - made)):
                made += 1
                cut = draw.randint(0, len(calls))
                acknowledged = calls[cut].acknowledged if cut < len(calls) else last
                disk = deepcopy(start)
                for call in calls[:cut]:
                    disk.see(call)
                disk.cut(draw)
                problem = _problem(name, disk, path, commits, acknowledged)
                yield f'{name} {commits}, cut after {cut} of {len(calls)} calls', problem


def _recorded(
    name: str, path: Path, commits: list[int], folder: Path
) -> tuple[Disk, list[Call], int]:
    """Return the disk at the start, every call, and the last acknowledged number."""
    SCENARIOS[name].prepare(path, commits)
    start = Disk(folders={path.parent.stat().st_ino: str(path.parent)})
    for one in path.parent.iterdir():
        start.names[str(one)] = one.stat().st_ino
        start.files[one.stat().st_ino] = bytearray(one.read_bytes())
    acknowledged = Acknowledged()
    record = folder / 'record'
    if not (child := os.fork()):
        with recorded(record, acknowledged):
            SCENARIOS[name].act(path, commits, acknowledged)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    return start, [*_calls(record.read_bytes())], acknowledged.value


def _calls(data: bytes) -> Iterator[Call]:
    """Yield the calls of a record; file numbers that are reused become unique."""
    at, renumbered, fresh = 0, dict[int, int](), itertools.count(-2, -1)
    while at < len(data):
        what, file, where, acknowledged, named, size = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        name, content = data[at : at + named], data[at + named : at + named + size]
        at += named + size
        if chr(what) == 'o':
            renumbered[file] = next(fresh)
        number = renumbered.get(file, file)
        yield Call(chr(what), number, where, acknowledged, name.decode(), content)


def _problem(name: str, disk: Disk, path: Path, commits: list[int], acknowledged: int) -> str:
    """Return the problem of a disk's content, or an empty text."""
    path.parent.mkdir()
    try:
        for each, file in sorted(disk.names.items()):
            if file == -1:
                Path(each).mkdir(0o700)  # as in `tempfile`
            elif Path(each).parent.exists():
                Path(each).write_bytes(disk.files.get(file, b''))
        SCENARIOS[name].check(path, commits, acknowledged)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f'{error!r} ({where.name}, line {where.lineno})'
    finally:
        shutil.rmtree(path.parent)
    return ''


if __name__ == '__main__':
    print_tries(tries)
