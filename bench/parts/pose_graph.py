# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The time from a closure to the corrected pose, in a pose graph of a long drive.

A robot takes random turns in a grid of streets. One closure in twenty is false.
"""

import importlib.util
from itertools import pairwise
import time

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.rigid import inverse, Matrix, turned_by
from convseq_ros.core.types import Doubles
from convseq_ros.pose_graph.closures import Closure
from convseq_ros.pose_graph.graph import PoseGraph
import numpy as np

from bench.finding import Finding
from bench.material import resident_mb, Work

_KEYFRAMES, _CLOSURES, _FALSE = 10_000, 1_000, 0.05
_QUICK_KEYFRAMES, _QUICK_CLOSURES = 900, 40
_MOST_MS, _MOST_MB = 20.0, 300.0
_STEP_M, _BLOCK_STEPS, _CORNERS = 2.0, 30, 8  # keyframes per block, and corners in a row
_SECOND = 1_000_000_000
_SIGMAS = np.array([0.2] * 3 + [0.03] * 3)  # of closures, metres and radians


def measure(work: Work) -> list[Finding]:
    """Measure odometry messages, closures, and memory at the end; CPU time on all cores."""
    if importlib.util.find_spec('gtsam') is None:
        return [Finding(what='pose graph', note='not measured: gtsam is not installed')]
    keyframes = _QUICK_KEYFRAMES if work.quick else _KEYFRAMES
    closures = _closures(keyframes, _QUICK_CLOSURES if work.quick else _CLOSURES)
    graph, messages, updates = PoseGraph(PoseGraphConfig(graph_spacing_m=1.0)), [], []
    for number, odometry in enumerate(_drifted(_true_poses(keyframes))):
        start_ns = time.process_time_ns()
        graph.add_odometry((number + 1) * _SECOND, odometry)
        messages.append(time.process_time_ns() - start_ns)
        for closure in closures.get(number, ()):
            start_ns = time.process_time_ns()
            graph.add_closure(closure)
            if problem := graph.problem():
                graph.adopt(problem, problem.solve())
                updates.append(time.process_time_ns() - start_ns)
    counts = graph.counts
    kept = f'{counts["kept"]:,} kept, {counts["refused"]:,} refused'

    def finding(side: str, taken_ns: Doubles | list[int], share: float, note: str) -> Finding:
        value = float(np.percentile(taken_ns, share)) / 1e6
        most = None if work.quick else _MOST_MS
        what = f'pose graph, {keyframes:,} keyframes, {len(updates):,} closures'
        return Finding(what=what, side=side, value=value, most=most, runs=len(taken_ns), note=note)

    last = updates[-len(updates) // 10 :]
    return [
        finding('message of odometry, 95 %', messages, 95, 'moves map -> odom'),
        finding('closure, median', updates, 50, kept),
        finding('closure, 95 %', updates, 95, f'worst: {max(updates) / 1e6:.0f} ms'),
        finding('closure, 95 % of the last tenth', last, 95, ''),
        Finding(
            what='pose graph', side='resident', value=resident_mb(), unit='MB', most=_MOST_MB,
            note='without the node',
        ),
    ]  # fmt: skip


def _pose(at: Doubles, yaw: float) -> Matrix:
    pose = np.eye(4)
    pose[:3, :3], pose[:2, 3] = turned_by((0, 0, yaw)), at
    return pose


def _true_poses(count: int) -> list[Matrix]:
    """Return the true poses (4, 4): at each corner a random turn, but none back."""
    rng, corner, heading = np.random.default_rng(0), np.zeros(2, int), 0
    ahead = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    at, poses = np.zeros(2), list[Matrix]()
    while len(poses) < count:
        goals = [corner + ahead[turn] for turn in range(4)]
        inside = [bool(((goal >= 0) & (goal < _CORNERS)).all()) for goal in goals]
        allowed = [at for at in range(4) if inside[at] and (at - heading) % 4 != 2]
        heading = int(rng.choice(allowed))
        corner = goals[heading]
        for _ in range(_BLOCK_STEPS):
            at = at + _STEP_M * ahead[heading]
            poses.append(_pose(at, heading * np.pi / 2))
    return poses[:count]


def _drifted(true_poses: list[Matrix]) -> list[Matrix]:
    rng, poses = np.random.default_rng(1), [true_poses[0]]
    for before, after in pairwise(true_poses):
        noise = _pose(rng.normal(0, 0.07, 2), rng.normal(0, 0.004))
        poses.append(poses[-1] @ inverse(before) @ after @ noise)
    return poses


def _closures(keyframes: int, count: int) -> dict[int, list[Closure]]:
    """Return closures by keyframe: right ones where a place is driven again, and false ones."""
    rng, poses = np.random.default_rng(2), _true_poses(keyframes)
    before = dict[tuple[int, ...], int]()
    pairs, covariance = list[tuple[int, int, Matrix]](), np.diag(_SIGMAS**2)
    for number, pose in enumerate(poses):
        key = (*np.rint(pose[:2, 3]).astype(int).tolist(), *np.rint(pose[:2, 0]).astype(int))
        if number - before.setdefault(key, number) > _BLOCK_STEPS:
            noise = _pose(rng.normal(0, 0.15, 2), rng.normal(0, 0.02))
            pairs.append((number, before[key], inverse(poses[before[key]]) @ pose @ noise))
    chosen = [pairs[at] for at in np.linspace(0, len(pairs) - 1, count).astype(int)]
    found = dict[int, list[Closure]]()
    for number, place, moved in chosen:
        if rng.uniform() < _FALSE:
            place, moved = int(rng.integers(0, number - _BLOCK_STEPS)), np.eye(4)
        stamps = (number + 1) * _SECOND, (place + 1) * _SECOND
        found.setdefault(number, []).append(Closure(*stamps, moved, covariance))
    return found
