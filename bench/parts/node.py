# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live node: raw images of 640 x 480 over DDS, from published image to published answer."""

from collections.abc import Iterator
from contextlib import contextmanager
import importlib.util
import os
from pathlib import Path
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

from convseq_ros.errors import ConvseqError
import numpy as np

from bench.finding import at_most, Finding
from bench.part import BLAS
from bench.work import Work

if TYPE_CHECKING:
    from bench.probe import Run

_SIZE = 10_000
_RATES_HZ = 10, 20, 30
_SECONDS = 10
_WARM_SECONDS = 3
_WANTED_HZ = 30
_MOST_P95_MS = {1: 60, 2: 40}


def measure(work: Work) -> list[Finding]:
    """Send images at three rates to a node that has one core, or as many as are allowed."""
    size = max(size for size in work.sizes if size <= _SIZE)
    what = f'node, 640 x 480 raw, R = {size:,}'
    if importlib.util.find_spec('rclpy') is None:
        return [Finding(what=what, side='vpr_node', threads=work.threads, note='no ROS here')]
    from bench.probe import isolate, Probe

    isolate(work.folder)
    findings = []
    with running_node(work, work.map_path(size)) as process:
        probe = Probe(work.images)
        try:
            probe.wait()
            probe.publish(10, 1 if work.quick else _WARM_SECONDS, process.pid)
            for rate_hz in _RATES_HZ[:1] if work.quick else _RATES_HZ:
                run = probe.publish(rate_hz, 1 if work.quick else _SECONDS, process.pid)
                findings.append(_told(work, f'{what}, {rate_hz} Hz', rate_hz, run))
        finally:
            probe.close()
    return findings


def _told(work: Work, what: str, rate_hz: int, run: 'Run') -> Finding:
    if not run.latencies_ms:
        raise ConvseqError('the node gave no answer')
    p50, p95, p99 = (float(one) for one in np.percentile(run.latencies_ms, (50, 95, 99)))
    dropped, most_ms = run.sent - len(run.latencies_ms), _MOST_P95_MS.get(work.threads)
    note = f'p50 {p50:.1f}, p99 {p99:.1f} ms; {dropped} of {run.sent} dropped; '
    note += f'CPU {run.cpu_percent:.0f} % of a core'
    if run.late:
        note += f'; {run.late} images published late'
    finding = Finding(
        what=what,
        side='p95, image to answer',
        threads=work.threads,
        value=p95,
        low=p50,
        high=p99,
        runs=len(run.latencies_ms),
        note=note,
    )
    if rate_hz != _WANTED_HZ or not most_ms:
        return finding
    return finding.aiming(at_most(p95, most_ms, 'ms'), at_most(dropped, 0, 'frames dropped'))


def _environment() -> dict[str, str]:
    """Return it without what the bench set for BLAS: the node decides that for itself."""
    return {name: value for name, value in os.environ.items() if name not in BLAS}


@contextmanager
def running_node(work: Work, path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run the node with a map on the first cores; the probe may use the others."""
    from bench.probe import TOPIC

    cores = sorted(os.sched_getaffinity(0))
    own, others = cores[: work.threads], cores[work.threads :] or cores
    command = [
        sys.executable,
        '-m',
        'convseq_ros.node.vpr_node',
        '--ros-args',
        '-p',
        f'map_path:={path.absolute()}',
        '-r',
        f'image:={TOPIC}',
    ]
    with Path(work.folder, 'vpr_node.log').open('wb') as log:
        process = subprocess.Popen(
            command,
            env=_environment(),
            stdout=log,
            stderr=subprocess.STDOUT,
            preexec_fn=lambda: os.sched_setaffinity(0, own),
        )
        os.sched_setaffinity(0, others)
        try:
            yield process
        finally:
            os.sched_setaffinity(0, cores)
            process.send_signal(signal.SIGINT)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
