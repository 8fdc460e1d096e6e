# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives round a square, as they are and by odometry that drifts, and their closures."""

import math

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.rigid import inverse, Matrix, turned_by
from convseq_ros.pose_graph.closures import Closure
from convseq_ros.pose_graph.graph import PoseGraph
import numpy as np

SECOND = 1_000_000_000
SIDE, LAP = 20, 80
MEASURED = np.diag([0.01] * 3 + [1e-4] * 3)


def pose(x: float, y: float = 0.0, yaw: float = 0.0) -> Matrix:
    moved = np.eye(4)
    moved[:3, :3], moved[:2, 3] = turned_by((0, 0, yaw)), (x, y)
    return moved


def squares(laps: int = 2, scale: float = 1.0, excess_rad: float = 0.0) -> list[Matrix]:
    """Return poses round a square with sides of 20 m, a metre apart."""
    poses = [np.eye(4)]
    for step in range(LAP * laps):
        turn = math.pi / 2 + excess_rad if step % SIDE == SIDE - 1 else 0.0
        poses.append(poses[-1] @ pose(scale, 0.0, turn))
    return poses


TRUE = squares()
DRIFTED = squares(scale=1.03, excess_rad=0.08)


def stamp(step: int) -> int:
    return SECOND + step * SECOND // 5


def closure(query: int, reference: int, moved: Matrix | None = None, **more: object) -> Closure:
    if moved is None:
        moved = inverse(TRUE[reference]) @ TRUE[query]
    return Closure(stamp(query), stamp(reference), moved, MEASURED, **more)


RIGHT = [closure(LAP + at, at) for at in range(1, LAP, 5)]


def driven(poses: list[Matrix], graph: PoseGraph | None = None, first: int = 0) -> PoseGraph:
    graph = graph or PoseGraph(PoseGraphConfig(graph_spacing_m=0.9))
    for step, at in enumerate(poses, first):
        graph.add_odometry(stamp(step), at)
    return graph
