# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulates a disk that fails at the n-th changing call, with a preloaded C library."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import ctypes
from enum import IntEnum
import functools
import json
import mmap
import os
from pathlib import Path
import shutil
import subprocess
import sys

from convseq_ros.core.map import autosave

from bench.torture.attack import Try

_NEVER_S = 1e6


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
    library = folder / 'disk.so'
    source = Path(__file__).with_name('disk.c')
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


def print_tries(make: Callable[[int, int, Path], Iterator[tuple[str, str]]]) -> None:
    """Make the tries of the command line, and print each as JSON."""
    count, seed, folder = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
    autosave._COMMIT_EVERY_S = _NEVER_S  # commit only on request
    for attempt in make(count, seed, folder):
        print(json.dumps(attempt), flush=True)


def tries_of(module: str, count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Run a module as a program on the simulated disk; yield its tries."""
    command = [sys.executable, '-m', f'bench.torture.{module}', str(count), str(seed), str(folder)]
    with subprocess.Popen(
        command, env=environment(folder), stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        for line in process.stdout:
            yield Try(*json.loads(line))
    if process.returncode:
        yield Try('all', f'ended with {process.returncode}')
