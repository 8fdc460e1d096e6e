# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What maps take on disk and in memory, and how long they take to open."""

import json
import os
from pathlib import Path
import subprocess
import sys

import numpy as np

from bench.finding import at_most, Finding
from bench.material import queries_path
from bench.work import Work

_WANTED_SIZE = 100_000
_MOST_MB, _MOST_OPEN_S, _MOST_KB = 300, 3, 20
_RUNS = 3


def measure(work: Work) -> list[Finding]:
    """Open each map in processes of their own, from the disk and from the system's cache."""
    sizes = work.sizes[-1:] if work.quick else work.sizes
    return [finding for size in sizes for finding in _map(work, size)]


def _map(work: Work, size: int) -> list[Finding]:
    path = work.map_path(size)
    kb = path.stat().st_size / 1e3 / size
    _forget(path)
    cold = _opened(work, path)
    warm = [cold] if work.quick else [_opened(work, path) for _ in range(_RUNS)]
    open_s = float(np.median([run['open_s'] for run in warm]))
    warm_s = float(np.median([run['warm_s'] for run in warm]))
    resident_mb = float(np.median([run['resident_mb'] for run in warm]))
    before_mb = float(np.median([run['before_mb'] for run in warm]))
    most_mb = max(run['most_mb'] for run in warm)
    what = f'map, R = {size:,}'
    opened = Finding(
        what=what,
        side='open',
        unit='s',
        value=open_s,
        runs=len(warm),
        note=f'{cold["open_s"]:.2f} s when it is not in the file cache; loading the kernels '
        f'takes {warm_s:.2f} s more',
    )
    resident = Finding(
        what=what,
        side='resident',
        unit='MB',
        value=resident_mb,
        runs=len(warm),
        note=f'{before_mb:.0f} MB of them Python and libraries; {most_mb:.0f} MB at most',
    )
    stored = Finding(
        what=what, side='disk, a reference', unit='kB', value=kb, note='thumbnails included'
    )
    if size == _WANTED_SIZE:
        opened = opened.aiming(at_most(open_s, _MOST_OPEN_S, 's'))
        resident = resident.aiming(at_most(resident_mb, _MOST_MB, 'MB'))
        stored = stored.aiming(at_most(kb, _MOST_KB, 'kB'))
    return [opened, resident, stored]


def _forget(path: Path) -> None:
    """Have the system drop a file from its cache."""
    with path.open('rb') as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def _opened(work: Work, path: Path) -> dict[str, float]:
    command = [sys.executable, '-m', 'bench.resident', str(path), str(queries_path(work.folder))]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)
