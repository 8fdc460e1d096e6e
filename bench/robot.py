# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs real nodes in separate processes, with a camera and a listener on their topics."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
import os
from pathlib import Path
import re
import subprocess
import sys
import time
from typing import Any

from convseq_ros.cli.processes import end, environment, node_arguments
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
VPR, GRAPH = 'vpr_node', 'pose_graph_node'


class Robot:
    """Nodes in processes of their own, a camera for `vpr_node`, and what they tell."""

    def __init__(self, folder: Path) -> None:
        os.environ.update(environment(folder))
        self._folder, self._context = folder, Context()
        self._context.init()
        self.node = rclpy.create_node('robot', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}  # by the node's name
        self.told: dict[str, dict[str, str]] = {}  # the last diagnostics, by the node's name
        self.answers = 0  # of vpr_node, received so far
        self.greeted = 0  # images of `greet` that the node received
        self.took_ms: list[float] = []  # from the call of `publish` to the answer
        self._sent_s: dict[int, float] = {}
        self.camera = self.node.create_publisher(Image, '/image', QoSProfile(depth=1000))
        deep, listen = QoSProfile(depth=100_000), self.node.create_subscription
        listen(PointCloud2, f'/{VPR}/candidates', self._on_answer, deep)
        listen(DiagnosticArray, '/diagnostics', self._on_diagnostics, 100)

    def start(
        self,
        name: str,
        parameters: Mapping[str, object],
        surroundings: Mapping[str, str] | None = None,
        cores: Sequence[int] = (),
    ) -> None:
        """
        Start `vpr_node`, or else a pose graph of this name; its log is NAME.log.

        `surroundings` are added to its environment, those that are empty are taken from it. It
        runs on `cores`, or on all.
        """
        words = {
            key: str(value).lower() if isinstance(value, bool) else value
            for key, value in parameters.items()
        }
        program = node_arguments('__main__' if name == VPR else GRAPH, words)
        own = {'PYTHONPATH': os.pathsep.join(sys.path)}
        variables = os.environ | own | dict(surroundings or {})
        with (self._folder / f'{name}.log').open('ab') as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, *program, '-r', f'__node:={name}'],
                env={name: value for name, value in variables.items() if value},
                cwd=self._folder,
                stdout=log,
                stderr=subprocess.STDOUT,
                preexec_fn=(lambda: os.sched_setaffinity(0, cores)) if cores else None,
            )

    def close(self) -> None:
        """End the nodes, and this one: its publishers would stay."""
        for process in self.processes.values():
            end(process, _END_S)
        self.node.destroy_node()
        self._context.try_shutdown()

    @property
    def process(self) -> subprocess.Popen[bytes]:
        """The process of `vpr_node`."""
        return self.processes[VPR]

    @property
    def diagnostics(self) -> Mapping[str, str]:
        """The last diagnostics of `vpr_node`."""
        return self.told.get(VPR, {})

    def spin(self, seconds: float = 0.0) -> None:
        """Receive messages for a time."""
        until_s = time.monotonic() + seconds
        while True:
            left_s = until_s - time.monotonic()
            self._executor.spin_once(timeout_sec=max(0.0, left_s))
            if left_s <= 0:
                return

    def wait_for(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Spin until the condition holds; return whether it held in time, while nodes live."""
        until_s = time.monotonic() + seconds
        while not condition():
            is_over = any(one.poll() is not None for one in self.processes.values())
            if time.monotonic() > until_s or is_over:
                return bool(condition())
            self.spin(0.02)
        return True

    def publish(self, message: Image) -> None:
        """Publish an image with a unique stamp, and measure the time to its answer."""
        self._sent_s[stamp_to_ns(message.header.stamp)] = time.perf_counter()
        self.camera.publish(message)

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
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self.told[status.name.partition(':')[0]] = values


@contextmanager
def robot(
    folder: Path,
    surroundings: Mapping[str, str] | None = None,
    cores: Sequence[int] = (),
    waits: bool = True,
    **parameters: object,
) -> Iterator[Robot]:
    """Start `vpr_node`, by default until it is ready, and end it with the block."""
    with closing(Robot(folder)) as one:
        one.start(VPR, parameters, surroundings, cores)
        if waits:
            one.wait_until_ready()
        yield one


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
