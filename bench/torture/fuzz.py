# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every decoder, given what is almost right, by a program that Atheris instruments."""

from collections.abc import Iterator
from importlib.util import find_spec
import json
from pathlib import Path
import subprocess
import sys

from bench.torture.attack import Try

ABOUT = (
    'Every decoder, fuzzed by Atheris (libFuzzer, led by the lines of convseq_ros that are '
    'reached) from valid samples: pictures, raw and compressed images, camera_info, poses, '
    'recordings, maps, masks, result tables, truth, YAML; so many executions each'
)
ORACLE = 'an answer, or an error of ours in one line; within 5 s, below 1 GB'
COUNT, PORTION, SHORT, SEED = 20_000, 20_000, 50, 16
MISSING = '' if find_spec('atheris') else "Atheris is missing; run: pip install '.[torture]'"


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Have a program of its own fuzz every decoder `count` times."""
    if MISSING:
        raise SystemExit(f'fuzz: {MISSING}')
    command = [sys.executable, '-m', 'bench.torture._fuzzer', str(count), str(seed), str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        for line in process.stdout:
            name, executions, problem = json.loads(line)
            yield from (Try(name) for _ in range(executions - 1))
            yield Try(name, problem)
    if process.returncode:
        yield Try('all', f'ended with {process.returncode}')
