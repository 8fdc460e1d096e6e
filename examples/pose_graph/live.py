# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Plays the drive to vpr_node and to the pose graph over DDS, each in a separate process."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import subprocess
import time
from typing import Any

from convseq_ros.cli.processes import environment, player_arguments, running, wait_for_rows
from convseq_ros.errors import ConvseqError
from graph import Closure
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

_HERE = Path(__file__).resolve().parent
_LOOP_CLOSURE = '/vpr_node/loop_closure'
_REMAPPED = ['-r', f'loop_closure:={_LOOP_CLOSURE}', '-r', 'pose:=/vpr_node/pose']
_REMAPPED += ['-r', 'closure:=/vpr_node/closure']
_STALLED_S = 30.0
_END_S = 60.0
_POLL_S = 0.2


class FalseClosures(Node):
    """Publishes each false closure on `loop_closure` when odometry reaches its time."""

    def __init__(self, false: Sequence[Closure], context: Context) -> None:
        super().__init__('false_closures', context=context)
        self._pairs = sorted([item.query_ns / 1e9, item.reference_ns / 1e9] for item in false)
        self._closures = self.create_publisher(Float64MultiArray, _LOOP_CLOSURE, 10)
        self.create_subscription(Odometry, 'odom', self._on_odometry, 1000)

    def _on_odometry(self, message: Any) -> None:
        now_s = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
        while self._pairs and self._pairs[0][0] < now_s:
            self._closures.publish(Float64MultiArray(data=self._pairs.pop(0)))


def play(
    folder: Path,
    frames: int,
    rate: float,
    settings: Mapping[str, object],
    false: Sequence[Closure],
) -> None:
    """
    Run all nodes until every frame of a recording is processed; ConvseqError if a process fails.

    The folder holds the recording `drive`. Logs, `vpr_node.csv` and `pose_graph.json` are written
    there. The recording is played at `rate` times its speed to a vpr_node with `settings`, and
    `false` closures are sent in between.
    """
    table = folder / 'vpr_node.csv'
    vpr = ['-m', 'convseq_ros.node.vpr_node', *_parameters(settings, table)]
    graph = [
        str(_HERE / 'pose_graph_node.py'),
        *_parameters({'use_pose': 'true', 'use_closure': 'true'}, folder / 'pose_graph.json'),
        *_REMAPPED,
    ]
    player = player_arguments(folder / 'drive', rate)
    with (
        _false_closures(false, folder) as sender,
        running('pose_graph', graph, folder, _END_S) as back_end,
        running('player', player, folder, _END_S) as playing,
    ):
        nodes = {'pose_graph': back_end}
        _wait_for_back_end({**nodes, 'player': playing}, folder)
        # The player waits for vpr_node, so start it last: then all nodes get the first message.
        with running('vpr_node', vpr, folder, _END_S) as node:
            nodes['vpr_node'] = node
            while playing.poll() is None:
                _check(nodes, folder)
                sender.spin_once(timeout_sec=_POLL_S)
            if playing.returncode:
                raise ConvseqError(f'the player failed; see {folder / "player.log"}')
            rows = wait_for_rows(table, frames, _STALLED_S)
            _check(nodes, folder)
            if rows < frames:
                raise ConvseqError(
                    f'{rows} of {frames} frames were recognised; see {folder}/*.log'
                )


@contextmanager
def _false_closures(false: Sequence[Closure], folder: Path) -> Iterator[SingleThreadedExecutor]:
    """Yield the executor of a node that sends false closures to the nodes of a folder."""
    os.environ.update(environment(folder))
    context = Context()
    context.init()
    executor, node = SingleThreadedExecutor(context=context), FalseClosures(false, context)
    executor.add_node(node)
    try:
        yield executor
    finally:
        node.destroy_node()
        context.try_shutdown()


def _wait_for_back_end(processes: Mapping[str, subprocess.Popen[bytes]], folder: Path) -> None:
    until_s = time.monotonic() + _STALLED_S
    while 'hears odometry' not in (folder / 'pose_graph.log').read_text():
        _check(processes, folder)
        if time.monotonic() > until_s:
            raise ConvseqError(f'pose_graph hears nothing; see {folder / "pose_graph.log"}')
        time.sleep(_POLL_S)


def _check(processes: Mapping[str, subprocess.Popen[bytes]], folder: Path) -> None:
    for name, process in processes.items():
        if process.poll() is not None:
            raise ConvseqError(f'{name} stopped; see {folder / name}.log')


def _parameters(settings: Mapping[str, object], result_file: Path) -> list[str]:
    """Return a node's parameters as command-line arguments."""
    values = {**settings, 'result_file': result_file}
    return ['--ros-args', *(p for name in values for p in ('-p', f'{name}:={values[name]}'))]
