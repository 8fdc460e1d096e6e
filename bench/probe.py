# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes images over DDS at a steady rate, and clocks the answers of the node."""

from array import array
from dataclasses import dataclass, field
import os
from pathlib import Path
import threading
import time

from convseq_ros.cli.processes import environment
from convseq_ros.errors import ConvseqError
from convseq_ros.node.conversions import stamp_to_ns
import cv2
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import numpy.typing as npt
import rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import Image, PointCloud2

TOPIC = '/bench/image'
_PATIENCE_S = 60.0
_LAST_ANSWERS_S = 2.0
_TICKS_S = os.sysconf('SC_CLK_TCK')


@dataclass(slots=True)
class Run:
    """
    What came of one rate.

    Parameters
    ----------
    sent : int
        Images.
    latencies_ms : list of float
        From the call that published an image to the arrival of its answer.
    late : int
        Images that were published more than a tenth of a period late: the probe's own fault.
    cpu_percent : float
        Of one core, of the node.
    told : dict
        The node's last diagnostics.

    """

    sent: int = 0
    latencies_ms: list[float] = field(default_factory=list)
    late: int = 0
    cpu_percent: float = 0.0
    told: dict[str, str] = field(default_factory=dict)


class Probe:
    """
    A camera and a listener in one, for one node.

    Parameters
    ----------
    images : ndarray of uint8, shape (n, H, W)
        Gray; published as bgr8 one after another, again and again.

    """

    def __init__(self, images: npt.NDArray[np.uint8]) -> None:
        self._messages = [_message(image) for image in images]
        self._next = 0
        self._sent_ns: dict[int, int] = {}
        self._run = Run()
        self._answered_s = 0.0  # when the last answer came, time.perf_counter
        rclpy.init()
        self._node = rclpy.create_node('bench_probe')
        self._publisher = self._node.create_publisher(Image, TOPIC, 10)
        self._node.create_subscription(PointCloud2, '/vpr_node/candidates', self._on_answer, 100)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown()

    def wait(self) -> None:
        """Wait until the node listens and talks; ConvseqError if it does not."""
        end_s = time.monotonic() + _PATIENCE_S
        while not (
            self._publisher.get_subscription_count()
            and self._node.count_publishers('/vpr_node/candidates')
        ):
            if time.monotonic() > end_s:
                raise ConvseqError('the node did not come up')
            time.sleep(0.05)

    def publish(self, rate_hz: float, seconds: float, pid: int) -> Run:
        """Publish at a rate, and return what came of it; the node's process is `pid`."""
        self._run = run = Run()
        period_s = 1 / rate_hz
        start_s, before = time.perf_counter(), _cpu_s(pid)
        for number in range(int(rate_hz * seconds)):
            due_s = start_s + number * period_s
            time.sleep(max(0.0, due_s - time.perf_counter()))
            run.late += time.perf_counter() > due_s + period_s / 10
            self._send()
            run.sent += 1
        took_s = time.perf_counter() - start_s
        run.cpu_percent = 100 * (_cpu_s(pid) - before) / took_s
        end_s = time.monotonic() + _LAST_ANSWERS_S
        while len(run.latencies_ms) < run.sent and time.monotonic() < end_s:
            time.sleep(0.01)
        return run

    def first_answer_s(self, rate_hz: float, start_s: float) -> float:
        """Publish at a rate until the first answer comes; return when, after `start_s`."""
        self._run, end_s = Run(), time.perf_counter() + _PATIENCE_S
        while not self._run.latencies_ms:
            if time.perf_counter() > end_s:
                raise ConvseqError('the node gave no answer')
            self._send()
            time.sleep(1 / rate_hz)
        return self._answered_s - start_s

    def _send(self) -> None:
        message = self._messages[self._next % len(self._messages)]
        self._next += 1
        stamp_ns = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        self._sent_ns[stamp_ns] = time.perf_counter_ns()
        self._publisher.publish(message)

    def _on_answer(self, message: PointCloud2) -> None:
        now_ns = time.perf_counter_ns()
        sent_ns = self._sent_ns.pop(stamp_to_ns(message.header.stamp), None)
        if sent_ns is not None:
            self._answered_s = now_ns / 1e9
            self._run.latencies_ms.append((now_ns - sent_ns) / 1e6)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self._run.told = {one.key: one.value for one in message.status[0].values}


def isolate(folder: Path) -> None:
    """Keep probe and node, which inherits it, among themselves; before rclpy is initialised."""
    os.environ.update(environment(folder))


def _message(image: npt.NDArray[np.uint8]) -> Image:
    height, width = image.shape
    data = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR).tobytes()
    return Image(
        height=height, width=width, step=3 * width, encoding='bgr8', data=array('B', data)
    )


def _cpu_s(pid: int) -> float:
    """Return the processor time that a process used so far."""
    fields = Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rpartition(') ')[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_S
