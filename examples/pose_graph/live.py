# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The drive played to vpr_node and to the pose graph, each in a process of its own, over DDS."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from convseq_ros.errors import ConvseqError
from convseq_ros.results import read_results

_HERE = Path(__file__).resolve().parent
_CLOSURES = ['-r', 'loop_closure:=/vpr_node/loop_closure']
_POSES = ['-r', 'pose:=/vpr_node/pose']
_STALLED_S = 30.0
_HIGHEST_DOMAIN = 101
_END_S = 60.0


def play(folder: Path, frames: int, rate: float, settings: Mapping[str, object]) -> None:
    """
    Run all of it until every frame was recognised.

    Parameters
    ----------
    folder : Path
        Holds the recording `drive` and the pairs of times `false_closures.json`; gets the logs,
        `vpr_node.csv` and `pose_graph.json`.
    frames : int
        Of the recording.
    rate : float
        Seconds of the recording in a second.
    settings : mapping of str
        Parameters of vpr_node.

    Raises
    ------
    ConvseqError
        If a process fails.

    """
    table = folder / 'vpr_node.csv'
    vpr = ['-m', 'convseq_ros.node.vpr_node', *_parameters(settings, table)]
    graph = [
        str(_HERE / 'pose_graph_node.py'),
        *_parameters({'use_pose': 'true'}, folder / 'pose_graph.json'), *_CLOSURES, *_POSES,
    ]
    liar = [
        str(_HERE / 'false_closures.py'), str(folder / 'false_closures.json'), '--ros-args',
        *_CLOSURES,
    ]
    player = [
        '-m', 'convseq_ros.node.player', str(folder / 'drive'), '--rate', f'{rate:g}',
        '--odom', '/odom', '--camera-info', '/camera/camera_info', '--wait-subscribers', '60',
    ]
    # The player waits for vpr_node, which is the last of the others to listen.
    with (
        _running('pose_graph', graph, folder) as back_end,
        _running('false_closures', liar, folder) as injector,
        _running('vpr_node', vpr, folder) as node,
        _running('player', player, folder) as playing,
    ):
        nodes = {'pose_graph': back_end, 'false_closures': injector, 'vpr_node': node}
        while playing.poll() is None:
            _check(nodes, folder)
            time.sleep(0.2)
        if playing.returncode:
            raise ConvseqError(f'the player failed; see {folder / "player.log"}')
        rows = _wait_for_rows(table.with_name(table.name + '.part'), frames)
        _check(nodes, folder)
        if rows < frames:
            raise ConvseqError(f'{rows} of {frames} frames were recognised; see {folder}/*.log')


def _check(processes: Mapping[str, subprocess.Popen[bytes]], folder: Path) -> None:
    for name, process in processes.items():
        if process.poll() is not None:
            raise ConvseqError(f'{name} stopped; see {folder / name}.log')


def _wait_for_rows(table: Path, wanted: int) -> int:
    """Wait until the table has as many rows, or stops growing; return how many it has."""
    rows, changed_s = 0, time.monotonic()
    while rows < wanted and time.monotonic() - changed_s < _STALLED_S:
        now = len(read_results(table)) if table.exists() else 0
        if now > rows:
            rows, changed_s = now, time.monotonic()
        time.sleep(0.2)
    return rows


def environment(folder: Path) -> dict[str, str]:
    """Return an environment in which the processes of this one hear each other and nobody else."""
    return {
        **os.environ,
        'ROS_DOMAIN_ID': str(os.getpid() % (_HIGHEST_DOMAIN + 1)),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_LOG_DIR': str(folder / 'log'),
    }


@contextmanager
def _running(name: str, arguments: list[str], folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run Python with these arguments until the block ends; then ask the process to end."""
    with (folder / f'{name}.log').open('wb') as log:
        process = subprocess.Popen(
            [sys.executable, *arguments], env=environment(folder),
            stdout=log, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _parameters(settings: Mapping[str, object], result_file: Path) -> list[str]:
    """Return a node's parameters as its command line takes them."""
    values = {**settings, 'result_file': result_file}
    return ['--ros-args', *(p for name in values for p in ('-p', f'{name}:={values[name]}'))]
