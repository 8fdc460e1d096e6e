# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is solved of a growing pose graph at a time."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from convseq_ros.core.rigid import Matrix
from convseq_ros.pose_graph.alignment import agreed
from convseq_ros.pose_graph.closures import Known
from convseq_ros.pose_graph.edges import Edge
from convseq_ros.pose_graph.optimisation import ROBUST, Solution
from convseq_ros.pose_graph.solver import Solver


@dataclass(frozen=True, eq=False, slots=True)
class Problem:
    """What is solved at a time; it does not change while the graph grows."""

    new: dict[int, Matrix]  # nodes that were not solved before, and their poses (4, 4)
    poses: Callable[[], dict[int, Matrix]]  # of all nodes
    steps: list[Edge]  # odometry between successive nodes
    links: list[Known]  # the closures
    held: dict[int, float]
    first: int  # node of the running drive
    solver: Solver

    def solve(self) -> Solution:
        """Return the robust solution; ConvseqError if GTSAM is not installed."""
        edges = [one.edge for one in self.links if one.edge]
        solution = self.solver.extended(self.new, self.steps, edges, self.held)
        return solution or self.solver.anew(self._aligned(edges), self.steps, edges, self.held)

    def of_drive(self) -> 'Problem':
        """Return it for the running drive alone: earlier ones stay where they are."""
        first, poses = self.first, self.poses()
        links = [one for one in self.links if one.edge and one.edge.end >= first]
        starts = {one.edge.start for one in links if one.edge and one.edge.start < first}
        held = {at: ROBUST.held for at in starts} | {first: self.held[first]}
        nodes = {at: pose for at, pose in poses.items() if at >= first or at in starts}
        steps = [step for step in self.steps if step.start >= first]
        return replace(self, poses=lambda: nodes, steps=steps, links=links, held=held)

    def _aligned(self, edges: list[Edge]) -> dict[int, Matrix]:
        """Return the poses, with the running drive where most links with earlier drives see it."""
        poses, first = self.poses(), self.first
        between = [edge for edge in edges if edge.end >= first > edge.start]
        if not between:
            return poses
        move = agreed([(poses[one.start] @ one.moved, poses[one.end]) for one in between])
        return poses | {at: move @ pose for at, pose in poses.items() if at >= first}
