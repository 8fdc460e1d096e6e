# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The size of maps on disk and in memory, and the time to open them.

Each map is opened in separate processes: this module, started with a map and images.
"""

import json
import os
from pathlib import Path
import statistics
import subprocess
import sys
import time

from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config import Config
from convseq_ros.core.types import Frame
import numpy as np

from bench.finding import Finding
from bench.material import resident_mb, Work

_WANTED_SIZE = 100_000
_MOST_MB, _MOST_OPEN_S, _MOST_KB = 300, 3, 32
_RUNS = 3
_PERIOD_NS = 100_000_000


def measure(work: Work) -> list[Finding]:
    """Measure each map, from the disk and from the system's cache."""
    sizes = work.sizes[-1:] if work.quick else work.sizes
    return [finding for size in sizes for finding in _map(work, size)]


def _map(work: Work, size: int) -> list[Finding]:
    path, is_wanted = work.map_path(size), size == _WANTED_SIZE
    with path.open('rb') as file:  # evict it from the system's cache
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
    cold = _opened(work, path)
    warm = [cold] if work.quick else [_opened(work, path) for _ in range(_RUNS)]

    def finding(side: str, value: float, unit: str, most: float, note: str) -> Finding:
        wanted = most if is_wanted else None
        what = f'map, R = {size:,}'
        return Finding(
            what=what, side=side, value=value, unit=unit, most=wanted, runs=len(warm), note=note
        )

    of = {name: statistics.median(run[name] for run in warm) for name in cold}
    cold_note = f'{cold["open_s"]:.2f} s when it is not in the file cache'
    libraries = f'{of["before_mb"]:.0f} MB of them Python and libraries'
    kb = path.stat().st_size / 1e3 / size
    return [
        finding('open', of['open_s'], 's', _MOST_OPEN_S, cold_note),
        finding('resident', of['resident_mb'], 'MB', _MOST_MB, libraries),
        finding('disk, a place', kb, 'kB', _MOST_KB, 'thumbnails and keypoints included'),
    ]


def _opened(work: Work, path: Path) -> dict[str, float]:
    command: list[str | Path] = [sys.executable, '-m', 'bench.parts.memory']
    command += [path, work.queries_path]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def use(path: Path, queries: Path) -> dict[str, float]:
    """Open a map in this process, process every image once, and return time and memory."""
    images = np.load(queries, mmap_mode='r')  # only its head: what is mapped is resident
    _, height, width = images.shape
    Pipeline(None, Config()).warm_up()
    before_mb, start_s = resident_mb(), time.perf_counter()
    pipeline = Pipeline(path, Config())
    open_s = time.perf_counter() - start_s
    pipeline.warm_up()
    for number in range(len(images)):
        begin = images.offset + number * height * width
        image = np.fromfile(queries, np.uint8, height * width, offset=begin)
        pipeline.recognizer.process(Frame(number * _PERIOD_NS, image.reshape(height, width)))
    return {'open_s': open_s, 'before_mb': before_mb, 'resident_mb': resident_mb()}


if __name__ == '__main__':
    print(json.dumps(use(Path(sys.argv[1]), Path(sys.argv[2]))))
