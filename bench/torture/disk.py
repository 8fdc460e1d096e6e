# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A disk that fails, by a preloaded C library, and what a kill or a power cut leaves on it."""

from collections.abc import Iterator
import ctypes
from dataclasses import dataclass, replace
import functools
import itertools
import os
from pathlib import Path
import random
import shutil
import struct
import subprocess

_SECTOR = 512
_HEAD = struct.Struct('<5q')


def compiler() -> str | None:
    """Return the path of the C compiler, or None."""
    return shutil.which('cc')


def environment(folder: Path) -> dict[str, str]:
    """Compile the library into a folder; return an environment that preloads it."""
    library, source = folder / 'disk.so', Path(__file__).with_name('disk.c')
    command = ['cc', '-shared', '-fPIC', '-O1', '-o', str(library), str(source), '-ldl']
    subprocess.run(command, check=True)
    return os.environ | {'LD_PRELOAD': str(library)}


@functools.cache
def _library() -> ctypes.CDLL:
    return ctypes.CDLL(os.environ['LD_PRELOAD'])


def arm(record: Path, call: int, is_full: bool) -> None:
    """Record every call from now on; the n-th fails, or all from then on that need space."""
    file = os.open(record, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    _library().disk_arm(file, ctypes.c_long(call), ctypes.c_long(is_full))


def heal() -> None:
    """Let no call fail from now on."""
    _library().disk_heal()


def acknowledge(number: int) -> None:
    """Record that so much must be there from now on."""
    _library().disk_acknowledge(ctypes.c_long(number))


@dataclass(frozen=True, slots=True)
class Call:
    """
    A call that changed the disk; `data` is bytes or a second name.

    It is a write, truncation, sync, opening of a new file, new folder, unlinking or renaming, by
    its first letter; 'f' is one that failed, and 'a' acknowledges the number `at`.
    """

    what: str
    file: int
    at: int
    name: str
    data: bytes


def recorded_calls(record: Path) -> Iterator[Call]:
    """Yield the calls of a record; file numbers that are reused become unique."""
    data, at, renumbered, fresh = record.read_bytes(), 0, dict[int, int](), itertools.count(-2, -1)
    while at < len(data):
        what, file, where, named, size = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        name, content = data[at : at + named], data[at + named : at + named + size]
        at += named + size
        if chr(what) == 'o':
            renumbered[file] = next(fresh)
        number = renumbered.get(file, file)
        yield Call(chr(what), number, where, name.decode(), content)


def acknowledged(calls: list[Call]) -> int:
    """Return the number that was acknowledged last, or -1."""
    return next((call.at for call in reversed(calls) if call.what == 'a'), -1)


class Disk:
    """The synced content of a disk, at first the files of a folder, and the pending calls."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder.stat().st_ino
        self._names = {str(one): one.stat().st_ino for one in folder.iterdir()}  # folders are -1
        self._files = {
            number: bytearray(Path(name).read_bytes()) for name, number in self._names.items()
        }
        self._late = dict[int, list[Call]]()  # of the file; names are of the folder

    def see(self, call: Call) -> None:
        """Add a call."""
        if call.what == 's':
            for one in self._late.pop(call.file, []):
                self._do(one)
        elif call.what not in 'af':
            owner = call.file if call.what in 'wt' else self._folder
            self._late.setdefault(owner, []).append(call)

    def kill(self) -> None:
        """End the process, so that all calls count."""
        for pending in self._late.values():
            for one in pending:
                self._do(one)

    def cut(self, draw: random.Random) -> None:
        """Cut the power: of the pending calls, a random selection counts."""
        names = self._late.pop(self._folder, [])
        for one in names[: draw.randint(0, len(names))]:
            self._do(one)
        for pending in self._late.values():
            chance = draw.choice((0.0, 0.5, 0.9, 1.0))
            for call in pending:
                for one in _sectors(call):
                    if draw.random() < chance:
                        self._do(one)

    def restore(self) -> None:
        """Write the content to the real disk."""
        for name, file in sorted(self._names.items()):
            if file == -1:
                Path(name).mkdir(0o700)  # as in `tempfile`
            elif Path(name).parent.exists():
                Path(name).write_bytes(self._files.get(file, b''))

    def _do(self, call: Call) -> None:
        content = self._files.setdefault(call.file, bytearray())
        match call.what:
            case 'o':
                self._names[call.name] = call.file
            case 'm':
                self._names[call.name] = -1
            case 'u':
                self._names.pop(call.name, None)
            case 'r':
                self._names[call.data.decode()] = self._names.pop(call.name)
            case 't':
                del content[call.at :]
            case 'w':
                content.extend(bytes(max(0, call.at - len(content))))
                content[call.at : call.at + len(call.data)] = call.data


def _sectors(call: Call) -> Iterator[Call]:
    """Yield what a call writes to each sector; another call is whole."""
    for start in range(0, max(1, len(call.data)), _SECTOR):
        data = call.data[start : start + _SECTOR]
        yield replace(call, at=call.at + start, data=data)
