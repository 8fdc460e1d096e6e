# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives round a square, as they are and by odometry that drifts, and their closures."""

from dataclasses import replace
import math

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.graph.trail import Keyframe
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import inverse, Matrix, pose_of, turned_by
from convseq_ros.core.types import Anchor, RelativePose
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


def squares(
    laps: int = 2, scale: float = 1.0, excess_rad: float = 0.0, side: int = SIDE
) -> list[Matrix]:
    """Return poses round a square with sides of so many metres, a metre apart."""
    poses = [np.eye(4)]
    for step in range(4 * side * laps):
        turn = math.pi / 2 + excess_rad if step % side == side - 1 else 0.0
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


def relative(moved: Matrix) -> RelativePose:
    at = pose_of(moved)
    return RelativePose(at.orientation, at.position, None, MEASURED, 50, True)


def add_drive(to: ReferenceMap, poses, closures=(), first: int = 0, after_ns: int = 0) -> str:
    """Add a session of poses by odometry and closures (query, reference, moved)."""
    to.begin_session(stamp(first) + after_ns)
    own, ends = to.sessions[-1].id, {query: end for query, *end in closures}
    for step, odometry in enumerate(poses, first):
        other, moved = ends.get(step, (None, None))
        to.trail.add(
            Keyframe(
                own,
                stamp(step) + after_ns,
                replace(pose_of(odometry), variances=(0.0, 0.0)),
                None if other is None else Anchor(to.sessions[0].id, stamp(other)),
                None if moved is None else relative(moved),
            )
        )
    return own
