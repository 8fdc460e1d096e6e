# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs a part of the benchmark in a separate process, with its threads and library settings.

`run` starts the process, in which this module measures and prints JSON.
"""

from dataclasses import asdict, dataclass
import importlib
import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

from bench.finding import Finding

ALONE = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS', 'OPENCV_FOR_THREADS_NUM')


@dataclass(frozen=True, slots=True)
class Setting:
    """The number of cores, and the kernels as in `CONVSEQ_KERNELS`; empty for the best ones."""

    threads: int = 1
    kernels: str = ''


ONE, TWO = Setting(1), Setting(2)
PARTS = {
    'kernels': (ONE, Setting(1, 'avx2')),
    'frames': (ONE, Setting(1, 'avx2'), Setting(1, 'numpy')),
    'between': (ONE,),
    'memory': (ONE,),
    'node': (ONE, TWO),
    'pose_graph': (ONE,),
}


def run(
    name: str, setting: Setting, folder: Path, sizes: tuple[int, ...], quick: bool
) -> list[dict[str, Any]]:
    """Return the findings of a part as dictionaries; a failed part has one, with the reason."""
    cores = sorted(os.sched_getaffinity(0))
    if setting.threads > len(cores):
        return [_failed(name, setting, f'needs {setting.threads} cores')]
    environment = os.environ | dict.fromkeys(ALONE, '1')
    if setting.kernels:
        environment['CONVSEQ_KERNELS'] = setting.kernels
    told = json.dumps([str(folder), sizes, setting.threads, quick])
    command = [sys.executable, '-m', 'bench.part', name, told]

    def pin() -> None:
        if name != 'node':  # `node` pins itself, to leave cores for the camera
            os.sched_setaffinity(0, cores[: setting.threads])

    done = subprocess.run(
        command, env=environment, preexec_fn=pin, stdout=subprocess.PIPE, text=True, check=False
    )
    if done.returncode:
        return [_failed(name, setting, 'failed; see what it printed')]
    findings = json.loads(done.stdout.splitlines()[-1])
    kind = {'part': name, 'kernels': setting.kernels}
    return [kind | finding for finding in findings]


def _failed(name: str, setting: Setting, why: str) -> dict[str, Any]:
    finding = Finding(what=name, side='all', threads=setting.threads, note=why)
    return {'part': name, 'kernels': setting.kernels} | asdict(finding)


def main() -> None:
    """Measure one part and print its findings."""
    from bench.material import Work

    name, (folder, sizes, *how) = sys.argv[1], json.loads(sys.argv[2])
    work = Work(Path(folder), tuple(sizes), *how)
    findings = importlib.import_module(f'bench.parts.{name}').measure(work)
    print(json.dumps([asdict(finding) for finding in findings]))


if __name__ == '__main__':
    main()
