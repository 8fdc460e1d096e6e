# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live node: raw images of 640 x 480 over DDS, from published image to published answer."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
import importlib.util
import os
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from convseq_ros.errors import ConvseqError
import numpy as np
import numpy.typing as npt

from bench.finding import Finding
from bench.material import Work
from bench.part import ALONE

if TYPE_CHECKING:
    from bench.robot import Robot

_SIZE = 10_000
_RATES_HZ = 10, 30
_SECONDS, _STARTS = 10, 7
_LAST_ANSWERS_S, _PATIENCE_S = 2.0, 60.0
_WANTED_HZ = 30
# Targets of issue 37 for a core of 142 GOP/s.
_MOST_P95_MS, _MOST_PERCENT, _MOST_DRIVE_P95_MS, _MOST_START_S = 30, 22, 28, 1.2


def measure(work: Work) -> list[Finding]:
    """Start the node, send every frame, and drive with keyframes."""
    size = work.largest(_SIZE)
    what = f'node, 640 x 480 raw, R = {size:,}'
    if importlib.util.find_spec('rclpy') is None:
        return [Finding(what=what, threads=work.threads, note='no ROS here')]
    seconds = 1 if work.quick else _SECONDS
    findings = [_start(work, what, work.map_path(size))]
    with _node(work, work.map_path(size)) as one:
        _driven(one, work.images, _RATES_HZ[0], seconds / 3)  # it is warm then
        for rate_hz in _RATES_HZ[:1] if work.quick else _RATES_HZ:
            run = _driven(one, work.images, rate_hz, seconds)
            name = f'{what}, {rate_hz} Hz, every frame'
            most = _MOST_P95_MS if rate_hz == _WANTED_HZ and work.threads == 1 else None
            findings += _findings(work, name, *run, most)
    images = work.images_of(seconds * _WANTED_HZ)
    with _node(work, work.keyframe_map(size)) as one:
        _driven(one, images, _RATES_HZ[0], seconds / 3)
        name = f'drive of 10 m/s, {_WANTED_HZ} Hz, 8 keyframes a second, R = {size:,}'
        run = _driven(one, images, _WANTED_HZ, seconds)
        findings += _findings(work, name, *run, _MOST_DRIVE_P95_MS, _MOST_PERCENT)
    if work.threads == 1 and importlib.util.find_spec('onnx'):
        findings += _with_model(work, size, seconds)
    return findings


def _with_model(work: Work, size: int, seconds: int) -> list[Finding]:
    """Send every frame to a node with a descriptor model."""
    from diagnostic_msgs.msg import DiagnosticArray

    answers: list[dict[str, str]] = []

    def listen(message: Any) -> None:
        answers.append({one.key: one.value for one in message.status[0].values})

    model, path = work.model().absolute(), work.model_map(size)
    with _node(work, path, descriptor_model=model) as one:
        one.node.create_subscription(DiagnosticArray, '/vpr_node/answer', listen, 100)
        run = _driven(one, work.images, _RATES_HZ[0], seconds)
    model_ms, frame_ms = (
        np.median([float(answer[name]) for answer in answers if answer.get('model_ms')])
        for name in ('model_ms', 'duration_ms')
    )
    what = f'node with a model of 10 MFLOP, {_RATES_HZ[0]} Hz, R = {size:,}'
    by_answers = f"by ~/answer, {model_ms:.2g} of {frame_ms:.1f} ms are the model's"
    latency, dropped, share = _findings(work, what, *run)
    return [replace(latency, note=by_answers), replace(dropped, most=0), share]


def _driven(
    one: 'Robot', images: npt.NDArray[np.uint8], rate_hz: float, seconds: float
) -> tuple[int, list[float], float]:
    """Send images at a rate; return their number, the ms to each answer, and percent of a core."""
    one.took_ms = []
    count = max(1, int(rate_hz * seconds))
    messages = [_message(image) for image in images[:count]]
    begun_s, busy_s = time.perf_counter(), _cpu_s(one)
    for number in range(count):
        one.spin(begun_s + number / rate_hz - time.perf_counter())
        _send(one, messages[number % len(messages)])
    spent_s, took_s = _cpu_s(one) - busy_s, time.perf_counter() - begun_s
    one.wait_for(lambda: len(one.took_ms) >= count, _LAST_ANSWERS_S)
    return count, one.took_ms, 100 * spent_s / took_s


def _findings(
    work: Work,
    what: str,
    sent: int,
    took_ms: list[float],
    percent: float,
    most_ms: float | None = None,
    most_percent: float | None = None,
) -> list[Finding]:
    if not took_ms:
        raise ConvseqError('the node gave no answer')
    p50, p95, p99 = (float(one) for one in np.percentile(took_ms, (50, 95, 99)))
    finding = partial(Finding, what=what, threads=work.threads, runs=sent)
    return [
        finding(side='p95, image to answer', value=p95, low=p50, high=p99, most=most_ms,
                note=f'p50 {p50:.1f}, p99 {p99:.1f} ms'),
        finding(side='dropped', value=sent - len(took_ms), unit=f'of {sent}',
                most=0 if most_ms else None),
        finding(side='share of a core', value=percent, unit='%', most=most_percent),
    ]  # fmt: skip


def _start(work: Work, what: str, path: Path) -> Finding:
    """Start the node repeatedly while a camera is publishing."""
    found_s = []
    for _ in range(1 if work.quick else _STARTS):
        start_s = time.perf_counter()
        with _node(work, path, waits=False) as one:
            message = _message(work.images[0])
            while not one.took_ms and time.perf_counter() < start_s + _PATIENCE_S:
                _send(one, message)
                one.wait_for(partial(len, one.took_ms), 1 / _WANTED_HZ)
            found_s.append(time.perf_counter() - start_s)
    low, median, high = (float(one) for one in np.percentile(found_s, (0, 50, 100)))
    return Finding(
        what=what, side='start to first answer', threads=work.threads, value=median, unit='s',
        low=low, high=high, runs=len(found_s), most=_MOST_START_S,
    )  # fmt: skip


@contextmanager
def _node(work: Work, path: Path, waits: bool = True, **parameters: object) -> Iterator['Robot']:
    """Run the node with a map on the first cores; the camera uses the other cores."""
    from bench.robot import robot

    for name in ALONE:  # the node decides that for itself
        os.environ.pop(name, None)
    cores = sorted(os.sched_getaffinity(0))
    node_cores, camera_cores = cores[: work.threads], cores[work.threads :] or cores
    parameters['map_path'] = path.absolute()
    with robot(work.folder, None, node_cores, waits, **parameters) as one:
        os.sched_setaffinity(0, camera_cores)
        try:
            yield one
        finally:
            os.sched_setaffinity(0, cores)


def _message(gray: npt.NDArray[np.uint8]) -> Any:
    from bench.robot import image

    width = gray.shape[1]
    return image(np.repeat(gray, 3, axis=1), width=width, encoding='bgr8')


def _send(one: 'Robot', message: Any) -> None:
    stamp = message.header.stamp
    stamp.sec, stamp.nanosec = divmod(time.time_ns(), 10**9)
    one.publish(message)


def _cpu_s(one: 'Robot') -> float:
    """Return the CPU time of the node so far."""
    stat = Path(f'/proc/{one.process.pid}/stat').read_text(encoding='ascii')
    fields = stat.rpartition(') ')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
