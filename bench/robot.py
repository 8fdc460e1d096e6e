# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs a real node in a separate process, with a camera and a listener on its topics."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import re
import subprocess
import sys
import time
from typing import Any

from convseq_ros.cli.processes import end, environment
from convseq_ros.node.conversions import image_message, stamp_from_ns, stamp_to_ns
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

_START_S, _END_S = 90.0, 20.0
_SETTLE_S = 1.0
_NAME = '/vpr_node'


class Robot:
    """A camera and a listener for a node, which runs in `process`."""

    def __init__(self, process: subprocess.Popen[bytes], context: Context) -> None:
        self.process = process
        self.answers = 0  # received so far
        self.greeted = 0  # images of `greet` that the node received
        self.took_ms: list[float] = []  # from the call of `publish` to the answer
        self.diagnostics: Mapping[str, str] = {}  # the node's last diagnostics
        self._sent_s: dict[int, float] = {}
        self.node = rclpy.create_node('robot', context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self.camera = self.node.create_publisher(Image, '/image', QoSProfile(depth=1000))
        deep = QoSProfile(depth=100_000)
        self.node.create_subscription(PointCloud2, f'{_NAME}/candidates', self._on_answer, deep)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)

    def publish(self, message: Image) -> None:
        """Publish an image with a unique stamp, and measure the time to its answer."""
        self._sent_s[stamp_to_ns(message.header.stamp)] = time.perf_counter()
        self.camera.publish(message)

    def spin(self, seconds: float = 0.0) -> None:
        """Receive messages for a time."""
        until_s = time.monotonic() + seconds
        while True:
            left_s = until_s - time.monotonic()
            self._executor.spin_once(timeout_sec=max(0.0, left_s))
            if left_s <= 0:
                return

    def wait_for(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Spin until the condition holds; return whether it held in time."""
        until_s = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > until_s or self.process.poll() is not None:
                return bool(condition())
            self.spin(0.02)
        return True

    def wait_until_ready(self) -> None:
        """Wait until the node is enabled and subscribes to the camera, or raise RuntimeError."""
        ready = self.wait_for(lambda: self.diagnostics.get('state') == 'enabled', _START_S)
        if not (ready and self.wait_for(self.camera.get_subscription_count, _START_S)):
            raise RuntimeError('the node did not come up; see vpr_node.log')

    def count(self, name: str) -> int:
        """Return a count of the last diagnostics; 0 before the first ones."""
        return int(float(self.diagnostics.get(name, '0') or 0))

    def resident_mb(self, name: str = 'VmRSS') -> float:
        """Return the resident memory of the node; with 'VmHWM', its maximum so far."""
        text = Path(f'/proc/{self.process.pid}/status').read_text(encoding='ascii')
        line = re.search(rf'{name}:\s+(\d+) kB', text)
        return int(line[1]) / 1e3 if line else 0.0

    def number_of(self, what: str) -> int:
        """Return the number of threads ('task') or of open files and sockets ('fd')."""
        return len(os.listdir(f'/proc/{self.process.pid}/{what}'))

    def _on_answer(self, message: PointCloud2) -> None:
        self.answers += 1
        sent_s = self._sent_s.pop(stamp_to_ns(message.header.stamp), None)
        if sent_s is not None:
            self.took_ms.append((time.perf_counter() - sent_s) * 1e3)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.diagnostics = {item.key: item.value for item in message.status[0].values}


@contextmanager
def robot(
    folder: Path,
    surroundings: Mapping[str, str] | None = None,
    cores: Sequence[int] = (),
    waits: bool = True,
    **parameters: object,
) -> Iterator[Robot]:
    """
    Start a node with these parameters, and end it with the block; its log is vpr_node.log.

    `surroundings` are added to its environment, those that are empty are taken from it. It runs on
    `cores`, or on all. With `waits`, it is ready when the block begins.
    """
    os.environ.update(environment(folder))
    variables = os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)} | dict(surroundings or {})
    command = [sys.executable, '-m', 'convseq_ros.node', '--ros-args']
    for name, value in parameters.items():
        command += ['-p', f'{name}:={str(value).lower() if value in (True, False) else value}']
    context = Context()
    context.init()
    with (folder / 'vpr_node.log').open('ab') as log:
        process = subprocess.Popen(
            command,
            env={name: value for name, value in variables.items() if value},
            cwd=folder,
            stdout=log,
            stderr=subprocess.STDOUT,
            preexec_fn=(lambda: os.sched_setaffinity(0, cores)) if cores else None,
        )
        one = None
        try:
            one = Robot(process, context)
            if waits:
                one.wait_until_ready()
            yield one
        finally:
            end(process, _END_S)
            # Otherwise its publishers stay, and a node counts lost messages of one publisher only.
            if one:
                one.node.destroy_node()
            context.try_shutdown()


def image(gray: np.ndarray, stamp_ns: int = 0, **changes: Any) -> Image:
    """Return an image message, with changed fields."""
    message = image_message(gray, Header(stamp=stamp_from_ns(stamp_ns)))
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def greet(one: Robot) -> None:
    """
    Send images until one is answered; they are not counted.

    DDS matches the camera with the node earlier than the node with the camera. The node does not
    receive images sent in between, and does not count them as lost.
    """
    while not one.answers and one.process.poll() is None:
        one.camera.publish(image(np.zeros((48, 64), np.uint8), 1))
        one.spin(_SETTLE_S)
    one.greeted = -unaccounted(one, 0)


def unaccounted(one: Robot, sent: int) -> int:
    """Return the number of sent images that the node neither answered nor counts as lost."""
    counts = ('processed', 'dropped', 'lost_by_middleware', 'failed', 'queue')
    return sent + one.greeted - sum(one.count(name) for name in counts)
