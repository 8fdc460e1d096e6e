# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live node: raw images of 640 x 480 over DDS, from published image to published answer."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
import importlib.util
import os
from pathlib import Path
import subprocess
import sys
from typing import TYPE_CHECKING

from convseq_ros.cli.processes import end
from convseq_ros.errors import ConvseqError
import numpy as np
import numpy.typing as npt

from bench.finding import at_most, Finding
from bench.part import BLAS
from bench.work import Work

if TYPE_CHECKING:
    from bench.probe import Run

_SIZE = 10_000
_RATES_HZ = 10, 20, 30
_SECONDS = 10
_WARM_SECONDS = 3
_END_S = 10.0
_WANTED_HZ = 30
_MOST_P95_MS = {1: 60, 2: 40}


def measure(work: Work) -> list[Finding]:
    """Send images at three rates to a node that has one core, or as many as are allowed."""
    size = largest_map(work)
    what = f'node, 640 x 480 raw, R = {size:,}'
    if no_ros := without_ros(work, what):
        return no_ros
    findings = []
    with probed(work, work.map_path(size), work.images, _RATES_HZ[0]) as publish:
        for rate_hz in _RATES_HZ[:1] if work.quick else _RATES_HZ:
            run = publish(rate_hz, 1 if work.quick else _SECONDS)
            findings.append(_told(work, f'{what}, {rate_hz} Hz', rate_hz, run))
    return findings


def largest_map(work: Work) -> int:
    """Return the size of the map that a live node is measured with."""
    return max(size for size in work.sizes if size <= _SIZE)


def without_ros(work: Work, what: str) -> list[Finding]:
    """Return what there is to say where a node cannot run; nothing where it can."""
    if importlib.util.find_spec('rclpy') is not None:
        return []
    return [Finding(what=what, side='vpr_node', threads=work.threads, note='no ROS here')]


@contextmanager
def probed(
    work: Work, path: Path, images: npt.NDArray[np.uint8], rate_hz: float
) -> Iterator[Callable[[float, float], 'Run']]:
    """
    Run the node with a map, warmed up by images at a rate.

    Yields what publishes them at a rate in Hz for some seconds, and returns what came of it.
    """
    from bench.probe import isolate, Probe

    isolate(work.folder)
    with running_node(work, path) as process:
        probe = Probe(images)
        try:
            probe.wait()
            probe.publish(rate_hz, 1 if work.quick else _WARM_SECONDS, process.pid)
            yield partial(probe.publish, pid=process.pid)
        finally:
            probe.close()


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
            end(process, _END_S)
