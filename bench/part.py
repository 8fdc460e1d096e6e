# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One part of the bench in a process of its own: its threads, its memory, its libraries' settings.

`run` starts such a process; started itself, this module measures and prints JSON.
"""

import argparse
from dataclasses import asdict, dataclass
import importlib
import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

BLAS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')


@dataclass(frozen=True, slots=True)
class Setting:
    """
    Under what a part is measured.

    Parameters
    ----------
    threads : int
        That may compute.
    pinned : bool
        Whether the process has no more cores than that.
    kernels : str
        The kind of kernels, as CONVSEQ_KERNELS has it: the best if empty, or numpy for none.
    blas : int
        Threads of BLAS: as many as may compute if 0, or 1, as the node and the commands have it.

    """

    threads: int = 1
    pinned: bool = False
    kernels: str = ''
    blas: int = 0


ONE, TWO, ONE_CORE = Setting(1), Setting(2), Setting(1, pinned=True)
PARTS = {
    'encoding': (ONE, Setting(1, kernels='numpy')),
    'pairs': (ONE, TWO),
    'rows': (ONE, TWO),
    'frames': (ONE_CORE, Setting(1, pinned=True, kernels='numpy'), Setting(2, False, 'numpy', 1)),
    'sequence': (ONE,),
    'memory': (ONE,),
    'stages': (ONE_CORE,),
    'between': (ONE_CORE,),
    'avx2': (Setting(1, pinned=True, kernels='avx2'),),
    'start': (TWO, ONE),
    'node': (TWO, ONE),
    'drive': (ONE,),
}


def run(
    name: str, setting: Setting, folder: Path, sizes: tuple[int, ...], quick: bool
) -> list[dict[str, Any]]:
    """Return the findings of a part, as dictionaries; one line says why if it fails."""
    cores = sorted(os.sched_getaffinity(0))
    if setting.threads > len(cores):
        return [_failed(name, setting, f'needs {setting.threads} cores')]
    environment = os.environ | {key: str(setting.blas or setting.threads) for key in BLAS}
    if setting.kernels:
        environment['CONVSEQ_KERNELS'] = setting.kernels
    command = [
        sys.executable,
        '-m',
        'bench.part',
        name,
        '--folder',
        str(folder),
        '--sizes',
        *map(str, sizes),
        '--threads',
        str(setting.threads),
    ]

    def pin() -> None:
        if setting.pinned:
            os.sched_setaffinity(0, cores[: setting.threads])

    done = subprocess.run(
        command + ['--quick'] * quick,
        env=environment,
        preexec_fn=pin,
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode:
        return [_failed(name, setting, 'failed; see what it printed')]
    findings = json.loads(done.stdout.splitlines()[-1])
    return [{'part': name, **finding} for finding in findings]


def _failed(name: str, setting: Setting, why: str) -> dict[str, Any]:
    from bench.finding import Finding

    return {'part': name} | asdict(
        Finding(what=name, side='all', threads=setting.threads, note=why)
    )


def main() -> None:
    """Measure one part and print its findings."""
    from bench.work import Work

    parser = argparse.ArgumentParser()
    parser.add_argument('part', choices=PARTS)
    parser.add_argument('--folder', type=Path, required=True)
    parser.add_argument('--sizes', type=int, nargs='+', required=True)
    parser.add_argument('--threads', type=int, default=1)
    parser.add_argument('--quick', action='store_true')
    chosen = parser.parse_args()
    work = Work(chosen.folder, tuple(chosen.sizes), chosen.threads, chosen.quick)
    findings = importlib.import_module(f'bench.parts.{chosen.part}').measure(work)
    print(json.dumps([asdict(finding) for finding in findings]))


if __name__ == '__main__':
    main()
