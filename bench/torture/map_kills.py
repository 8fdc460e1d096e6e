# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SIGKILL at random moments to a program whose map grows, whether or not frames come."""

from collections.abc import Iterator
import mmap
import os
from pathlib import Path
import random
import signal
import struct
import tempfile
import time

from convseq_ros.core.map.autosave import Autosave

from bench.torture.attack import Try
from bench.torture.scenarios import APART, ENCODING, grow, holds

ABOUT = (
    'SIGKILL 0 to 3 s after the start of a program whose map grows by 1 to 100 places a second, '
    'for half of them after the camera stopped; of 16 programs at a time'
)
ORACLE = (
    'what was said to be committed is there, and what was added a second before the end; all of '
    'it is right; the next program goes on'
)
COUNT, PORTION, SHORT, SEED = 1_000, 96, 8, 16
_AT_ONCE = 16  # programs
_LONGEST_S = 3.0
_MOST_LOST_S = 1.0
_RECORD = struct.Struct('<qd')  # places that were added, and when: monotonic seconds
_MOST_RECORDS = 1_000


class Log:
    """What a child has done, for its parent to read when it is gone."""

    def __init__(self) -> None:
        self._shared = mmap.mmap(-1, _RECORD.size * (_MOST_RECORDS + 1))
        self._count = 0

    def added(self, places: int) -> None:
        """Say that a map has so many places."""
        self._count += 1
        _RECORD.pack_into(self._shared, self._count * _RECORD.size, places, time.monotonic())

    def committed(self, places: int) -> None:
        """Say that so many are safe."""
        _RECORD.pack_into(self._shared, 0, places, 0.0)

    def promised(self, killed_s: float) -> int:
        """Return how many places must be there after an end."""
        (most, _), *records = _RECORD.iter_unpack(self._shared[:])
        old = [places for places, at_s in records if 0 < at_s < killed_s - _MOST_LOST_S]
        return max([most, *old])


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Let some programs run at a time, and end each when its time has come."""
    draw = random.Random(seed)
    for first in range(0, count, _AT_ONCE):
        with tempfile.TemporaryDirectory(dir=folder) as own:
            lot = range(first, min(count, first + _AT_ONCE))
            yield from _lot([Path(own, f'{number}', 'map.db') for number in lot], draw)


def _lot(paths: list[Path], draw: random.Random) -> Iterator[Try]:
    ends, start_s = [], time.monotonic()
    for path in paths:
        path.parent.mkdir()
        log, ends_s = Log(), start_s + draw.uniform(0, _LONGEST_S)
        stops_s = ends_s if draw.random() < 0.5 else draw.uniform(start_s, ends_s)
        pause_s = 1 / draw.uniform(1, 100)
        if not (child := os.fork()):
            _grow(path, log, stops_s, pause_s)
        ends.append((ends_s, child, path, log, f'camera until {stops_s - start_s:.2f} s'))
    for ends_s, child, path, log, name in sorted(ends, key=lambda one: one[0]):
        time.sleep(max(0.0, ends_s - time.monotonic()))
        killed_s = time.monotonic()
        os.kill(child, signal.SIGKILL)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        problem = (
            f'ended with {code}' if code != -signal.SIGKILL else _problem(path, log, killed_s)
        )
        yield Try(f'{path.parent.name}: killed after {killed_s - start_s:.3f} s, {name}', problem)


def _grow(path: Path, log: Log, stops_s: float, pause_s: float) -> None:
    """Be a program with a camera; ends by being killed."""
    try:
        owner = Autosave(path, ENCODING, APART)
        while time.monotonic() < stops_s:
            grow(owner.reference_map, 1)
            log.added(len(owner.reference_map))
            owner.save()
            log.committed(owner.committed)
            time.sleep(pause_s)
        while True:
            log.committed(owner.committed)
            time.sleep(0.01)
    finally:
        os._exit(1)


def _problem(path: Path, log: Log, killed_s: float) -> str:
    promised = log.promised(killed_s)
    try:
        owner = Autosave(path, ENCODING, APART)
        there = len(owner.reference_map)
        grow(owner.reference_map, 1)
        owner.close()
        assert there >= promised, f'{there} places of {promised}'
        assert holds(path) == there + 1
    except Exception as error:
        return repr(error)
    return ''
