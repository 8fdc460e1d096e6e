# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes of slam.launch.py on a drawn town: `convseq demo --slam`."""

from collections.abc import Mapping, Sequence
import math
from pathlib import Path
import sys
import time

from convseq_ros.cli.processes import (
    need_ros,
    node_arguments,
    PATIENT,
    running,
    sender_arguments,
    wait_for_rows,
)
from convseq_ros.core.types import Doubles, Vector
from convseq_ros.errors import ConvseqError
from convseq_ros.pose_graph.optimisation import need_gtsam
from convseq_ros.simulation.town import record
from convseq_ros.sources.recording import read_poses
import numpy as np

# As in launch/slam.launch.py.
VPR = {'mode': 'online', 'closure_interval_s': 2.0, **PATIENT}
_RATE = 3.0
_END_S, _STALLED_S, _POLL_S = 60.0, 60.0, 0.2
_FALSE, _APART_M, _APART_NS = 6, 20.0, 30_000_000_000
_FALSE_CLOSURES = '-m', 'convseq_ros.node.outputs.false_closures'

Truth = Mapping[int, Vector]  # position in metres, by the stamps of odometry
Pairs = Sequence[tuple[int, int]]  # stamps of query and reference


def run_slam(folder: Path) -> None:
    """Draw a town, run the nodes, and print the error of the trajectory before and after."""
    need_ros('demo --slam')
    need_gtsam()
    recording = folder / 'drive'
    print('drawing a drive through a town ...', file=sys.stderr)
    record(recording)
    truth = {at: pose.position for at, pose in read_poses(recording, '/ground_truth')}
    odometry = {at: pose.position for at, pose in read_poses(recording, '/odom')}
    false = draw_false(truth, _FALSE)
    print(f'sending it to both nodes, at {_RATE:g} times its speed ...', file=sys.stderr)
    play(folder, len(truth), _RATE, VPR, false)
    after = read_trajectory(folder / 'trajectory.txt')
    told = (folder / 'pose_graph_node.log').read_text()
    refused = told.count(' is refused: ') - told.count(' is accepted after all: ')
    rows = [
        ('odometry alone', error_m(odometry, truth)),
        (f'closures, and {len(false)} false ones', error_m(after, truth)),
    ]
    print('\nTrajectory error (ATE RMSE after SE2 alignment), metres\n')
    for name, metres in rows:
        print(f'{name:32}{metres:8.2f}')
    print(f'\n{refused} closures refused; trajectory {folder / "trajectory.txt"}')


def play(
    folder: Path, frames: int, rate: float, settings: Mapping[str, object], false: Pairs = ()
) -> None:
    """
    Run both nodes until the recording `drive` of a folder is processed; ConvseqError if one fails.

    They write `vpr_node.csv`, `trajectory.txt`, `graph.g2o` and logs. `false` closures are sent in
    between.
    """
    table = folder / 'vpr_node.csv'
    vpr = node_arguments('vpr_node', {**settings, 'result_file': table})
    files = {'tum_file': folder / 'trajectory.txt', 'g2o_file': folder / 'graph.g2o'}
    graph = node_arguments('pose_graph_node', files)
    drive = sender_arguments(folder / 'drive', rate)
    sender = [*_FALSE_CLOSURES, *(str(at) for pair in false for at in pair)]
    with (
        running('pose_graph_node', graph, folder, _END_S) as back_end,
        running('false_closures', sender, folder, _END_S) as sending,
        running('drive_sender', drive, folder, _END_S) as driving,
    ):
        for name, process in (('pose_graph_node', back_end), ('false_closures', sending)):
            log, until_s = folder / f'{name}.log', time.monotonic() + _STALLED_S
            while 'listening' not in log.read_text():
                if process.poll() is not None or time.monotonic() > until_s:
                    raise ConvseqError(f'{name} does not start; see {log}')
                time.sleep(_POLL_S)
        # The drive waits for vpr_node, so start it last: then both nodes get the first message.
        with running('vpr_node', vpr, folder, _END_S) as node:
            while driving.poll() is None:
                if node.poll() is not None or back_end.poll() is not None:
                    raise ConvseqError(f'a node stopped; see {folder}/*.log')
                time.sleep(_POLL_S)
            if driving.returncode:
                raise ConvseqError(f'the drive was not sent; see {folder / "drive_sender.log"}')
            rows = wait_for_rows(table, frames, _STALLED_S)
            if rows < frames:
                raise ConvseqError(f'{rows} of {frames} frames were recognised; see {folder}')


def draw_false(truth: Truth, count: int) -> list[tuple[int, int]]:
    """Return pairs of times at which the robot was 20 m and 30 s apart, or more."""
    rng, stamps, pairs = np.random.default_rng(0), sorted(truth), list[tuple[int, int]]()
    while len(pairs) < count:
        reference_ns, query_ns = sorted(stamps[at] for at in rng.integers(0, len(stamps), 2))
        is_far = math.dist(truth[reference_ns], truth[query_ns]) >= _APART_M
        if is_far and query_ns - reference_ns >= _APART_NS:
            pairs.append((query_ns, reference_ns))
    return pairs


def read_trajectory(path: Path) -> Truth:
    """Return the positions of a file in the format of TUM, by their stamps."""
    rows = np.loadtxt(path, str, skiprows=1, usecols=range(4), ndmin=2).tolist()
    # Stamps have nine decimals.
    return {int(stamp.replace('.', '')): (float(x), float(y), float(z)) for stamp, x, y, z in rows}


def error_m(estimate: Truth, truth: Truth) -> float:
    """Return the absolute trajectory error: RMSE of positions, x and y, after SE2 alignment."""
    stamps = sorted(estimate.keys() & truth.keys())
    path, real = (np.array([one[at][:2] for at in stamps]) for one in (estimate, truth))
    return float(np.sqrt(np.mean(np.sum((_aligned(path, real) - real) ** 2, axis=1))))


def _aligned(path: Doubles, real: Doubles) -> Doubles:
    """Return a path (n, 2) turned and shifted to the best fit with another."""
    centre, goal = path.mean(axis=0), real.mean(axis=0)
    left, _, right = np.linalg.svd((real - goal).T @ (path - centre))
    flip = np.diag((1.0, np.sign(np.linalg.det(left @ right))))
    return np.asarray((path - centre) @ (left @ flip @ right).T + goal)
