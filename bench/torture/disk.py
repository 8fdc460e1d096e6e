# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulates a disk that fails at the n-th changing call, with a preloaded C library."""

from collections.abc import Iterator
from contextlib import contextmanager
import ctypes
from dataclasses import dataclass, field
from enum import IntEnum
import functools
import itertools
import mmap
import os
from pathlib import Path
import random
import shutil
import struct
import subprocess

_SECTOR = 512
_HEAD = struct.Struct('<6q')


class How(IntEnum):
    """The effect at the n-th call; the numbers are those of disk.c."""

    COUNT = 0  # nothing
    KILL = 1  # the process ends before it
    TEAR = 2  # the process ends after half of the write
    FULL = 3  # it fails, and all later calls that need space: the disk is full
    FAIL = 4  # only this call fails: a disk error


class Acknowledged:
    """A number in shared memory, which survives a killed child; -1 at first."""

    def __init__(self) -> None:
        self.shared = mmap.mmap(-1, 8)
        self.value = -1

    @property
    def value(self) -> int:
        return int.from_bytes(self.shared[:], 'little', signed=True)

    @value.setter
    def value(self, number: int) -> None:
        self.shared[:] = number.to_bytes(8, 'little', signed=True)


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


def arm(call: int, how: How) -> None:
    """Set the effect at the n-th call from now on, counted from 1."""
    _library().disk_arm(ctypes.c_long(call), int(how))


def calls() -> int:
    """Return the number of calls since `arm`."""
    return int(_library().disk_calls())


@contextmanager
def recorded(path: Path, number: Acknowledged) -> Iterator[None]:
    """Record every changing call in a file, together with the number."""
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    watched = ctypes.c_int64.from_buffer(number.shared)
    arm(0, How.COUNT)
    _library().disk_record(file, ctypes.byref(watched))
    try:
        yield
    finally:
        _library().disk_record(-1, None)
        os.close(file)


@dataclass(frozen=True, slots=True)
class Call:
    """A call that changed the disk; `data` is bytes or a second name."""

    what: str
    file: int
    at: int
    acknowledged: int
    name: str
    data: bytes


def recorded_calls(record: Path) -> Iterator[Call]:
    """Yield the calls of a record; file numbers that are reused become unique."""
    data, at, renumbered, fresh = record.read_bytes(), 0, dict[int, int](), itertools.count(-2, -1)
    while at < len(data):
        what, file, where, acknowledged, named, size = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        name, content = data[at : at + named], data[at + named : at + named + size]
        at += named + size
        if chr(what) == 'o':
            renumbered[file] = next(fresh)
        number = renumbered.get(file, file)
        yield Call(chr(what), number, where, acknowledged, name.decode(), content)


@dataclass(slots=True)
class Disk:
    """The synced content of a disk, and the pending calls."""

    names: dict[str, int]  # folders are -1
    files: dict[int, bytearray]
    folders: dict[int, str]
    late_names: list[Call] = field(default_factory=list)
    late: dict[int, list[Call]] = field(default_factory=dict)

    @classmethod
    def of(cls, folder: Path) -> 'Disk':
        """Return a disk with the files of a folder."""
        numbers = {str(one): one.stat().st_ino for one in folder.iterdir()}
        files = {number: bytearray(Path(name).read_bytes()) for name, number in numbers.items()}
        return cls(numbers, files, {folder.stat().st_ino: str(folder)})

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
        """Cut the power: apply a random selection of the pending calls."""
        for one in self.late_names[: draw.randint(0, len(self.late_names))]:
            self._rename(one)
        for pending in self.late.values():
            chance = draw.choice((0.0, 0.5, 0.9, 1.0))
            for one in pending:
                self._write(one, draw, chance)

    def restore(self) -> None:
        """Write the content to the real disk."""
        for name, file in sorted(self.names.items()):
            if file == -1:
                Path(name).mkdir(0o700)  # as in `tempfile`
            elif Path(name).parent.exists():
                Path(name).write_bytes(self.files.get(file, b''))

    def _rename(self, call: Call) -> None:
        if call.what in 'om':
            self.names[call.name] = call.file if call.what == 'o' else -1
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
