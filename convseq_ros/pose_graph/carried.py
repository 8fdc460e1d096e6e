# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a robot was carried: closures that agree with each other contradict its odometry."""

from collections.abc import Callable
from dataclasses import dataclass, field
import math

from convseq_ros.core.rigid import difference, Matrix, moved_covariance
from convseq_ros.core.types import constants
from convseq_ros.pose_graph.closures import Known
from convseq_ros.pose_graph.edges import Edge
from convseq_ros.pose_graph.odometry import Odometry
from convseq_ros.pose_graph.optimisation import ROBUST
import numpy as np


@constants
class CARRIED:
    """What it costs to say that odometry breaks, in refused closures; engineering, not studied."""

    cost: float = 2.5  # so three closures that agree make a break, ...
    hinted: float = 1.5  # ... and two where odometry or the localisation began anew
    looked_back: int = 30  # closures before one that are compared with it


@dataclass(eq=False)
class Carried:
    """
    The closures of a drive in the order of their queries, and the cheapest way through them.

    On the way a closure agrees with the one before, by the odometry between their queries, or
    odometry breaks there, which costs as much as a few closures off the way. So false closures,
    which seldom agree, break nothing; and a break that later closures do not bear out is undone.
    The first one agrees with odometry alone, if its reference is in the same drive.
    """

    drive: Odometry
    pose: Callable[[int], Matrix]  # returns the pose (4, 4) of a node
    _links: list[Known] = field(default_factory=list)
    _costs: list[float] = field(default_factory=list)  # of the cheapest way to each
    _before: list[tuple[int, bool]] = field(default_factory=list)  # on it, and whether it breaks

    def add(self, one: Known) -> None:
        """Add a closure with its edge; one that comes late, by its query, is passed over."""
        edge, count = _edge(one), len(self._links)
        newest = _edge(self._links[-1]).end if self._links else self.drive.first
        if edge.end < max(newest, edge.start):
            return
        ways = [(count + self._cost(None, edge), -1)]
        for at in range(max(0, count - CARRIED.looked_back), count):
            passed = self._costs[at] + count - 1 - at
            ways.append((passed + self._cost(_edge(self._links[at]), edge), at))
        cost, before = min(ways)
        passed = count if before < 0 else self._costs[before] + count - 1 - before
        self._links.append(one)
        self._costs.append(cost)
        self._before.append((before, cost > passed))

    def breaks(self) -> dict[int, Edge]:
        """
        Return the keyframes before which odometry breaks, each with the first closure after.

        A break begins where the solution refuses a closure; it stays while the way has it.
        """
        count = len(self._links)
        at = min(range(count), key=lambda number: self._costs[number] - number, default=-1)
        if at < 0 or self._costs[at] >= 1 + at:  # to refuse all is as cheap
            return {}
        found = dict[int, Edge]()
        while at >= 0:
            (before, is_break), one = self._before[at], self._links[at]
            if is_break:
                start = self._since(
                    _edge(self._links[before]) if before >= 0 else None, _edge(one)
                )
                node = self._hint(start, _edge(one).end) or _edge(one).end
                ends = [one, *self._links[max(0, before) : before + 1]]
                if node in self.drive.breaks or any(end.kept is False for end in ends):
                    found[node] = _edge(one)
            at = before
        return found

    def _since(self, before: Edge | None, edge: Edge) -> int:
        """Return the node from which odometry leads to the query of a closure."""
        return before.end if before else max(self.drive.first, edge.start)

    def _hint(self, start: int, end: int) -> int | None:
        """Return a node after one, up to another, where something began anew."""
        return next((node for node in self.drive.hints if start < node <= end), None)

    def _cost(self, before: Edge | None, edge: Edge) -> float:
        if (before is None and edge.start < self.drive.first) or self._agree(before, edge):
            return 0.0
        if (start := self._since(before, edge)) == edge.end:
            return math.inf  # at one time: one of both is wrong
        return CARRIED.hinted if self._hint(start, edge.end) else CARRIED.cost

    def _agree(self, before: Edge | None, edge: Edge) -> bool:
        """Return whether odometry leads from one closure (or a reference) to another."""
        start, noise = self._since(before, edge), np.zeros((6, 6))
        goal = self.pose(edge.start)
        if before:
            noise, goal = before.covariance, self.pose(before.start) @ before.moved
        step = self.drive.step(start, edge.end)
        turn = np.kron(np.eye(2), step.moved[:3, :3])
        noise = turn.T @ moved_covariance(noise, step.moved[:3, 3]) @ turn
        noise = noise + step.covariance + edge.covariance
        if before and min(before.start, edge.start) >= self.drive.first:  # as odometry has it
            noise = noise + self.drive.step(*sorted((before.start, edge.start))).covariance
        error = difference(goal @ step.moved, self.pose(edge.start) @ edge.moved)
        return bool(error @ np.linalg.solve(noise, error) <= ROBUST.inlier)


def _edge(one: Known) -> Edge:
    assert one.edge
    return one.edge
