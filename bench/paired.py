# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whole frames of this code against another's, in turn: `python -m bench.paired OTHER_CLONE`.

Each side draws its own maps, of the same street, and runs in processes of its own on one core; the
processor's time counts. The other clone must be built, and run with this Python.
"""

import argparse
import json
import os
from pathlib import Path
import statistics
import subprocess
import sys
import tempfile

_SIZES = 1_000, 10_000, 100_000
_FRAMES, _QUERIES = 60, 120
# Older code has its drive by another name, and reads no map into the file cache.
_SIDE = """
import json, os, sys, time
from pathlib import Path
folder, size = Path(sys.argv[1]), int(sys.argv[2])
os.sched_setaffinity(0, {0})
from bench import material
from bench.parts import frames
from bench.work import Work
folder.mkdir(parents=True, exist_ok=True)
material.prepare(folder, (size,), int(sys.argv[3]))
with material.map_path(folder, size).open('rb') as file:
    while file.read(1 << 24):
        pass
drive = getattr(frames, 'Drive', None) or frames._Drive
own = drive(Work(folder, (size,), 1, False), size, 'shortlist')
own.warm_up()
took_ms = []
for _ in range(int(sys.argv[4])):
    start_s = time.process_time()
    own.frame_ms()
    took_ms.append(1e3 * (time.process_time() - start_s))
print(json.dumps(took_ms))
"""


def main() -> None:
    """Print medians of both sides and of their ratio, round by round."""
    parser = argparse.ArgumentParser(prog='bench.paired', description=__doc__.splitlines()[1])
    parser.add_argument('other', type=Path, help='a clone of other code, built')
    parser.add_argument('--sizes', type=int, nargs='+', default=_SIZES)
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--folder', type=Path, help='keep maps there')
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='convseq_paired_') as own:
        folder = chosen.folder or Path(own)
        for size in chosen.sizes:
            sides = [(chosen.other.resolve(), folder / 'other'), (Path.cwd(), folder / 'this')]
            for side in sides:
                _median(*side, size, 1)  # draws the map
            rounds = [
                [_median(*side, size, _FRAMES) for side in sides] for _ in range(chosen.rounds)
            ]
            other, this = (statistics.median(one) for one in zip(*rounds, strict=True))
            ratio = statistics.median(new / old for old, new in rounds)
            print(
                f'R = {size:,}: other {other:.1f} ms, this {this:.1f} ms, this / other {ratio:.2f}'
            )


def _median(tree: Path, folder: Path, size: int, frames: int) -> float:
    command = [sys.executable, '-c', _SIDE, *map(str, (folder, size, _QUERIES, frames))]
    settings = os.environ | {'PYTHONPATH': str(tree), 'OPENBLAS_NUM_THREADS': '1'}
    done = subprocess.run(command, cwd=tree, env=settings, stdout=subprocess.PIPE, check=True)
    return statistics.median(json.loads(done.stdout))


if __name__ == '__main__':
    main()
