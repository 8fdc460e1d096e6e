# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the node takes of a core on a drive of 10 m/s, with at most 8 keyframes a second."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import subprocess
import sys
from typing import TYPE_CHECKING

from convseq_ros.errors import ConvseqError
import numpy as np

from bench.finding import at_most, Finding
from bench.material import keyframe_map, read_drive
from bench.parts.node import largest_map, probed, without_ros
from bench.work import Work

if TYPE_CHECKING:
    from bench.probe import Run

_RATE_HZ = 30
_SECONDS = 10
_NEIGHBOURS = 2
_MOST_PERCENT, _MOST_P95_MS = 25, 30
_SPINNING = 'sum(number * number for number in iter(int, 1))'
_JOULES = Path('/sys/class/powercap/intel-rapl:0/energy_uj')  # of all cores together


def measure(work: Work) -> list[Finding]:
    """Drive past a node alone, and beside two programs that take what they get."""
    size = largest_map(work)
    what = f'drive of 10 m/s, {_RATE_HZ} Hz, 8 keyframes a second, R = {size:,}'
    if no_ros := without_ros(work, what):
        return no_ros
    findings = []
    seconds = 1 if work.quick else _SECONDS
    images = read_drive(work.folder, seconds * _RATE_HZ)
    with probed(work, keyframe_map(work.folder, size), images, _RATE_HZ) as publish:
        for neighbours in (0, 1 if work.quick else _NEIGHBOURS):
            with _busy(neighbours):
                before = _joules()
                run = publish(_RATE_HZ, seconds)
                after = _joules()
            joules = None if before is None or after is None else after - before
            findings.append(_told(work, what, neighbours, run, joules))
    return findings


def _told(work: Work, what: str, neighbours: int, run: 'Run', joules: float | None) -> Finding:
    if not run.latencies_ms:
        raise ConvseqError('the node gave no answer')
    p50, p95 = (float(one) for one in np.percentile(run.latencies_ms, (50, 95)))
    dropped = run.sent - len(run.latencies_ms)
    note = f'image to answer: p50 {p50:.1f}, p95 {p95:.1f} ms; {dropped} of {run.sent} dropped'
    if joules is not None:
        note += f'; {joules / run.sent:.2f} J a frame, of the whole processor'
    finding = Finding(
        what=what,
        side=f'node beside {neighbours} busy programs' if neighbours else 'node',
        threads=work.threads,
        value=run.cpu_percent,
        unit='% of a core',
        runs=run.sent,
        note=note,
    )
    percent = at_most(run.cpu_percent, _MOST_PERCENT, '% of a core')
    return finding.aiming(percent, at_most(p95, _MOST_P95_MS, 'ms')) if not neighbours else finding


@contextmanager
def _busy(count: int) -> Iterator[None]:
    """Let programs spin on all cores."""
    programs = [
        subprocess.Popen(
            [sys.executable, '-c', _SPINNING],
            preexec_fn=lambda: os.sched_setaffinity(0, range(os.cpu_count() or 1)),
        )
        for _ in range(count)
    ]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


def _joules() -> float | None:
    """Return what the processor took since it was started, if it tells."""
    try:
        return int(_JOULES.read_text(encoding='ascii')) / 1e6
    except (OSError, ValueError):
        return None
