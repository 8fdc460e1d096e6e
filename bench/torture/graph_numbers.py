# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odd numbers for a pose graph: covariances of odometry, and closures that are far off."""

from collections.abc import Iterator
import math
from pathlib import Path
import random

from convseq_ros.core.rigid import inverse, Matrix, turned_by
from convseq_ros.pose_graph.closures import Closure
from convseq_ros.pose_graph.graph import PoseGraph
import numpy as np

from bench.torture.attack import Try

_SIDE, _SECOND_NS = 10, 10**9  # keyframes of a side of the square, 2 m apart
_LAP = 4 * _SIDE
_ODD = (
    0.0, -1.0, 5e-324, 1e-300, 1e-20, 1e-9, 1e15, 1e300, -1e300, math.inf, -math.inf, math.nan,
)  # fmt: skip
_SPREAD = np.diag([0.01] * 3 + [4e-4] * 3)
_FURTHEST = 12.0  # power of ten, in metres
_MOST_OFF_M = 2.0


def graph_numbers(count: int, seed: int, _folder: Path) -> Iterator[Try]:
    """Drive round a square twice, with one closure far off among right ones, again and again."""
    draw = random.Random(seed)
    for number in range(count):
        try:
            problem = _driven(draw)
        except Exception as error:
            problem = repr(error)[:200]
        yield Try(str(number), problem)


def _square(scale: float, turn: float) -> list[Matrix]:
    poses = [np.eye(4)]
    for step in range(2 * _LAP):
        moved = np.eye(4)
        moved[:3, :3] = turned_by((0, 0, turn if step % _SIDE == _SIDE - 1 else 0.0))
        moved[0, 3] = 2 * scale
        poses.append(poses[-1] @ moved)
    return poses


_TRUE, _ODOMETRY = _square(1.0, math.pi / 2), _square(1.02, math.pi / 2 + 0.02)


def _driven(draw: random.Random) -> str:
    """Return what went wrong with a drive; empty if right closures alone are kept."""
    graph, share = PoseGraph(), draw.choice((0.02, 0.3, 1.0))
    growth = draw.choice((0.0, 1e-20, 1e-9, 1e-3, 1e15))
    first = draw.randrange(1, 5)  # right closures before the one that is far off
    right, far = list[Closure](), Closure(0, 0, np.eye(4), _SPREAD)
    for step, pose in enumerate(_ODOMETRY):
        told = growth * step, growth * step
        if draw.random() < share:
            told = draw.choice(_ODD), draw.choice(_ODD)
        graph.add_odometry(_stamp(step), pose, told)
        if step > _LAP and step % 4 == 0:
            right.append(_closure(step, inverse(_TRUE[step - _LAP]) @ _TRUE[step]))
            graph.add_closure(right[-1])
        if len(right) == first and step % 4 == 1:
            moved = np.eye(4)
            moved[draw.randrange(3), 3] = draw.choice((-1, 1)) * 10 ** draw.uniform(3, _FURTHEST)
            far = _closure(step, moved)
            graph.add_closure(far)
        if problem := graph.problem():
            graph.adopt(problem, problem.solve())
    if refused := [one for one in right if not graph.known[one.key].kept]:
        return f'{len(refused)} of {len(right)} right closures are refused'
    if graph.known[far.key].kept is not False:
        return f'{np.abs(far.moved[:3, 3]).max():g} m off is kept'
    assert graph.correction is not None
    off_m = math.dist((graph.correction @ _ODOMETRY[-1])[:3, 3], _TRUE[-1][:3, 3])
    return f'{off_m:.1f} m off' if not off_m < _MOST_OFF_M else ''


def _stamp(step: int) -> int:
    return _SECOND_NS + step * _SECOND_NS


def _closure(step: int, moved: Matrix) -> Closure:
    return Closure(_stamp(step), _stamp(step - _LAP), moved, _SPREAD)
