# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The drive played to vpr_node and to the pose graph, each in a process of its own, over DDS."""

from collections.abc import Mapping
from pathlib import Path
import subprocess
import time

from convseq_ros.cli.processes import player_arguments, running, wait_for_rows
from convseq_ros.errors import ConvseqError

_HERE = Path(__file__).resolve().parent
_CLOSURES = ['-r', 'loop_closure:=/vpr_node/loop_closure']
_POSES = ['-r', 'pose:=/vpr_node/pose', '-r', 'closure:=/vpr_node/closure']
_STALLED_S = 30.0
_END_S = 60.0
_POLL_S = 0.2


def play(folder: Path, frames: int, rate: float, settings: Mapping[str, object]) -> None:
    """
    Run all of it until every frame of a recording was recognised; ConvseqError if a process fails.

    The folder holds the recording `drive` and the pairs of times `false_closures.json`; it gets
    the logs, `vpr_node.csv` and `pose_graph.json`. It is played at `rate` times its speed, to a
    vpr_node with some `settings`.
    """
    table = folder / 'vpr_node.csv'
    vpr = ['-m', 'convseq_ros.node.vpr_node', *_parameters(settings, table)]
    graph = [
        str(_HERE / 'pose_graph_node.py'),
        *_parameters({'use_pose': 'true', 'use_closure': 'true'}, folder / 'pose_graph.json'),
        *_CLOSURES,
        *_POSES,
    ]
    liar = [
        str(_HERE / 'false_closures.py'),
        str(folder / 'false_closures.json'),
        '--ros-args',
        *_CLOSURES,
    ]
    player = player_arguments(folder / 'drive', rate)
    with (
        running('pose_graph', graph, folder, _END_S) as back_end,
        running('false_closures', liar, folder, _END_S) as injector,
        running('player', player, folder, _END_S) as playing,
    ):
        nodes = {'pose_graph': back_end, 'false_closures': injector}
        _wait_for_back_end({**nodes, 'player': playing}, folder)
        # The player waits for vpr_node, which therefore comes last: all hear its first message.
        with running('vpr_node', vpr, folder, _END_S) as node:
            nodes['vpr_node'] = node
            while playing.poll() is None:
                _check(nodes, folder)
                time.sleep(_POLL_S)
            if playing.returncode:
                raise ConvseqError(f'the player failed; see {folder / "player.log"}')
            rows = wait_for_rows(table, frames, _STALLED_S)
            _check(nodes, folder)
            if rows < frames:
                raise ConvseqError(
                    f'{rows} of {frames} frames were recognised; see {folder}/*.log'
                )


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
    """Return a node's parameters as its command line takes them."""
    values = {**settings, 'result_file': result_file}
    return ['--ros-args', *(p for name in values for p in ('-p', f'{name}:={values[name]}'))]
