# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The solution that grows is the one from scratch, and is decided anew where links contradict."""

import math

from convseq_ros.core.rigid import inverse, Matrix
from convseq_ros.pose_graph import solver as module
from convseq_ros.pose_graph.edges import Edge
from convseq_ros.pose_graph.optimisation import optimise, position_sigma_m
from convseq_ros.pose_graph.solver import Solver
import numpy as np
import pytest
from squares import pose

pytest.importorskip('gtsam', reason='needs gtsam: pip install gtsam')

COUNT, LAP = 240, 40
HELD = {0: 1e-4}
STEP = np.diag([0.05**2] * 3 + [0.02**2] * 3)
LINK = np.diag([0.1**2] * 3 + [0.02**2] * 3)


def path(yaw: float) -> list[Matrix]:
    poses = [np.eye(4)]
    for _ in range(COUNT - 1):
        poses.append(poses[-1] @ pose(1.0, 0.0, yaw))
    return poses


TRUE, DRIFTED = path(2 * math.pi / LAP), path(2 * math.pi / LAP + 0.002)
POSES = dict(enumerate(DRIFTED))
STEPS = [
    Edge(at, at + 1, inverse(DRIFTED[at]) @ DRIFTED[at + 1], STEP, False)
    for at in range(COUNT - 1)
]


def link(start: int, end: int, wrong: Matrix | None = None) -> Edge:
    right = inverse(TRUE[start]) @ TRUE[end]
    return Edge(start, end, right if wrong is None else wrong, LINK, True)


RIGHT = [link(at - LAP, at) for at in range(LAP, COUNT, 4)]


@pytest.fixture
def decided(monkeypatch):
    """Return the numbers of links on which graduated non-convexity decided."""
    calls = []

    def count(edges, *more):
        edges = [*edges]
        calls.append(sum(edge.is_link for edge in edges))
        return optimise(edges, *more)

    monkeypatch.setattr(module, 'optimise', count)
    return calls


def grow(solver: Solver, links: list[Edge]) -> list[tuple[bool, ...]]:
    """Hand links over one by one, each when the drive has just come to it; return the verdicts."""
    verdicts = []
    done = 0
    for number, last in enumerate(links, 1):
        new = {at: POSES[at] for at in range(done, last.end + 1)}
        asked = STEPS[: last.end], links[:number], HELD
        solution = solver.extended(new, *asked)
        if not solution:
            solution = solver.anew({at: POSES[at] for at in range(last.end + 1)}, *asked)
        done = max(done, last.end + 1)
        verdicts.append(solution.kept)
        solver.solution = solution
    return verdicts


def test_links_that_agree_are_taken_in_as_from_scratch(decided):
    solver = Solver()
    assert all(all(kept) for kept in grow(solver, RIGHT))
    assert decided == [1]  # the first one; iSAM2 takes in the others
    whole = optimise([*STEPS, *RIGHT], POSES, HELD)
    last = RIGHT[-1].end
    grown = np.array([solver.solution.poses[at] for at in range(last + 1)])
    exact = np.array([whole.poses[at] for at in range(last + 1)])
    assert np.abs(grown - exact)[:, :3, 3].max() < 0.05
    assert np.abs(exact - np.array(DRIFTED[: last + 1]))[:, :3, 3].max() > 1.0


def test_a_closure_that_contradicts_many_is_refused_and_bends_nothing(decided):
    links = [*RIGHT, link(100, RIGHT[-1].end, pose(9.0, 3.0))]
    alone, solver = Solver(), Solver()
    grow(alone, RIGHT)
    assert grow(solver, links)[-1] == (*[True] * len(RIGHT), False)
    assert decided == [1, 1]
    ends = [made.solution.poses[links[-1].end] for made in (alone, solver)]
    assert np.linalg.norm((ends[0] - ends[1])[:3, 3]) < 0.1


def test_an_early_closure_is_refused_once_enough_others_contradict_it(decided):
    false = [link(4, 44, pose(3.0, 6.0)), link(8, 46, pose(3.0, 6.0))]
    verdicts = grow(Solver(), [*false, *RIGHT[3:]])
    assert verdicts[-1] == (False, False, *[True] * len(RIGHT[3:]))
    assert len(decided) < len(RIGHT) / 2


def test_a_drive_of_kilometres_is_solved_although_little_is_known_of_its_end():
    """Steps of 100 m are known to 0.1 m, and their end to 440 m, by their heading."""
    count = 30
    poses = {at: pose(100.0 * at) for at in range(count)}
    spread = np.diag([0.01] * 3 + [2.5e-3] * 3)
    steps = [Edge(at, at + 1, pose(100.0), spread, False) for at in range(count - 1)]
    near = Edge(count - 3, count - 1, pose(200.0), LINK, True)
    solution = Solver().anew(poses, steps, [near], HELD)
    assert solution.kept == (True,)
    assert 400 < math.sqrt(solution.spread[1, 1]) < 450
    assert 150 < position_sigma_m(poses, [*steps, near]) < 250


def test_a_graph_that_is_held_otherwise_is_solved_anew():
    solver = Solver()
    grow(solver, RIGHT[:3])
    asked = POSES, STEPS, RIGHT[:4]
    assert solver.extended(*asked, {0: 1.0}) is None
