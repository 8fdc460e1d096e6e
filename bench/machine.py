# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The machine of the measurements: libraries, clock, and peak multiplication rate of a core."""

from collections.abc import Callable
from contextlib import suppress
import os
from pathlib import Path
import re
import shutil
import subprocess
import tempfile
import time
from typing import Any

from convseq_ros.core.compiled import Array, available, kernel, library, numbers, SIZE
from convseq_ros.evaluation.provenance import provenance
import numpy as np

_SIDE = 1024  # of the matrices that BLAS multiplies
_ACCUMULATORS, _LOOPS = 12, 500_000  # of the kernel `peak`, and its number of runs
_ROUNDS = 15
# Each addition depends on the previous one, and takes one cycle on every processor.
_CHAIN = r"""
#include <stdio.h>
#include <time.h>
#define STEP x += step; __asm__ volatile("" : "+r"(x));
#define STEPS STEP STEP STEP STEP STEP STEP STEP STEP
int main(void) {
    unsigned long x = 0, step = 1;
    struct timespec begin, end;
    double best = 0;
    __asm__ volatile("" : "+r"(step));
    for (int round = 0; round < 20; ++round) {
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begin);
        for (int i = 0; i < 500000; ++i) { STEPS STEPS STEPS STEPS }
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
        double ns = (end.tv_sec - begin.tv_sec) * 1e9 + end.tv_nsec - begin.tv_nsec;
        if (16e6 / ns > best) best = 16e6 / ns;
    }
    printf("%.2f\n", best);
    return 0;
}
"""


def described() -> dict[str, Any]:
    """Return machine, kernels, libraries and date, ready for JSON."""
    facts = provenance()
    blas = np.show_config(mode='dicts')['Build Dependencies']['blas']
    facts['machine'] |= {
        'cores': len(os.sched_getaffinity(0)),
        'memory_gb': round(os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 1e9, 1),
        'kernels': library().variant or 'none',
        'blas': f'{blas["name"]} {blas["version"]}',
        'load': round(os.getloadavg()[0], 2),
        'clock_ghz': clock_ghz(),
    }
    return facts


def clock_ghz() -> float | None:
    """Return the measured clock of a busy core; without a compiler, the clock of /proc/cpuinfo."""
    if compiler := shutil.which('cc') or shutil.which('gcc'):
        with (
            tempfile.TemporaryDirectory() as folder,
            suppress(OSError, subprocess.SubprocessError),
        ):
            program = f'{folder}/chain'
            build = [compiler, '-O1', '-x', 'c', '-', '-o', program]
            subprocess.run(build, input=_CHAIN, text=True, check=True, capture_output=True)
            done = subprocess.run([program], text=True, check=True, capture_output=True)
            return float(done.stdout)
    with suppress(OSError):
        reported_mhz = re.search(r'cpu MHz\s*:\s*([\d.]+)', Path('/proc/cpuinfo').read_text())
        return round(float(reported_mhz[1]) / 1e3, 2) if reported_mhz else None
    return None


def float32_peak() -> float:
    """Return the GFLOP/s of one core when BLAS multiplies float32 matrices."""
    left, right = np.random.default_rng(0).random((2, _SIDE, _SIDE), np.float32)
    product = np.empty_like(left)
    return _most_a_second(lambda: np.dot(left, right, out=product), 2 * _SIDE**3)


def int8_peak() -> float | None:
    """Return the GOP/s of one core for bytes in registers; None without kernels."""
    if not available():
        return None
    run, result = kernel('peak', SIZE, Array('i4')), np.empty(1, np.int32)
    products = 2 * numbers('shape', 2)[1]  # four per column, of one vector of two
    operations = 2 * products * _ACCUMULATORS * _LOOPS
    return _most_a_second(lambda: run(_LOOPS, result), operations)


def _most_a_second(work: Callable[[], object], operations: int) -> float:
    """Return 10^9 operations per second, in the best round."""
    best_ns = min(_took_ns(work) for _ in range(_ROUNDS))
    return operations / best_ns


def _took_ns(work: Callable[[], object]) -> int:
    start_ns = time.thread_time_ns()
    work()
    return time.thread_time_ns() - start_ns
