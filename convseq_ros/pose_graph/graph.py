# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A pose graph that grows while a robot drives: odometry, closures, corrected poses."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, takewhile
import math
from typing import Any

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.rigid import angle, inverse, Matrix, moved_covariance
from convseq_ros.core.types import constants
from convseq_ros.pose_graph.carried import Carried
from convseq_ros.pose_graph.closures import Closure, Known
from convseq_ros.pose_graph.edges import Edge, link_edge
from convseq_ros.pose_graph.odometry import Odometry
from convseq_ros.pose_graph.optimisation import ROBUST, Solution
from convseq_ros.pose_graph.problem import Problem
from convseq_ros.pose_graph.references import MAP, Place, References
from convseq_ros.pose_graph.solver import Solver
import numpy as np


@constants
class LIVE:
    """Limits of the growing graph."""

    fine: int = 500  # of a drive's first keyframes each is a node, ...
    every: int = 5  # ... of later ones one of so many, beside those at which queries end
    agreeing: int = 2  # closures with earlier drives that say where the running one is
    loose: float = 1e3  # standard deviation of the start of a drive, metres and radians
    patience_ns: int = 10_000_000_000  # until a closure without a counterpart counts as unusable
    most_waiting: int = 1000  # closures without both their places


@dataclass(eq=False)
class PoseGraph:
    """
    Collects odometry and closures; `problem` and `adopt` put a solution, made elsewhere, between.

    New keyframes extend a chain, whose best estimate needs no solver: the last correction moves
    them. The first drive begins where its odometry begins. With `earlier` drives, or poses in the
    frame of a map, the running drive is in their frame when two closures agree.
    """

    config: PoseGraphConfig = field(default_factory=PoseGraphConfig)
    earlier: list[Odometry] = field(default_factory=list)
    known: dict[tuple[int, str, int], Known] = field(default_factory=dict)
    nodes: dict[int, Matrix] = field(default_factory=dict)  # poses (4, 4) before they are solved
    in_map: bool = False  # whether there are places in the frame of a map, outside all drives
    without_place: int = 0  # closures of which a place is not in the graph, nor in the map's frame
    twice: int = 0  # closures that came again
    restarts: int = 0  # clocks that were set back
    apart_ns: tuple[int, int] | None = None  # query of a closure, and odometry far from it, if any

    def __post_init__(self) -> None:
        self._begin()
        self._references = References(self.config)
        self.add_pose = self._references.add_pose  # for closures whose place is not in the graph

    def _begin(self) -> None:
        """Begin a drive, and solve all anew."""
        first = 1 + sum(len(drive.keyframes) for drive in self.earlier)
        self.running, self._is_paused = Odometry(self.config, first), False
        # Whether the running drive is in the frame of the map.
        self._is_aligned = not (self.earlier or self.in_map)
        self._move = np.eye(4)  # correction of its newest keyframe
        # The keyframe that was solved last, and its covariance (6, 6), in its axes.
        self._solved, self._spread = first, np.zeros((6, 6))
        self._nodes: list[int] = []  # ascending
        self._steps: list[Edge] = []
        self._solver = Solver()
        self._solution: Solution | None = None
        self._carried = Carried(self.running, self._pose)

    def add_odometry(
        self, stamp_ns: int, pose: Matrix, told: tuple[float, float] | None = None
    ) -> None:
        """Add a pose (4, 4) of odometry; `told` are its variances, of position and heading."""
        if self._is_paused:
            if not self.running.goes_on(stamp_ns, pose):
                self._next_drive()
            elif stamp_ns <= self.running.stamps[-1]:
                return
            else:
                self.lose()
            self._is_paused = False
        elif self.running.is_anew(stamp_ns):
            self.restarts += 1
            self._next_drive()
        self.running.add(stamp_ns, pose, told)

    def pause(self) -> None:
        """Take note that odometry was not heard: the next pose may be of another drive."""
        self._is_paused = bool(self.running.keyframes)

    def _next_drive(self) -> None:
        """Begin another drive; the running one stays if closures may refer to it: in a map."""
        nodes, stays = self.running.nodes, bool(self.running.sessions)
        end = nodes.stop if stays else nodes.start
        self.nodes = {node: at for node, at in self.poses().items() if node < end}
        placed = [(key, one, one.edge) for key, one in self.known.items()]
        self.known = {key: one for key, one, edge in placed if edge and edge.end < end}
        if stays and nodes:
            self.earlier.append(self.running)
        self._begin()

    def name_session(self, session: str) -> None:
        """Add the id of a session that the running drive makes in a map."""
        self.running.sessions.add(session)

    def add_closure(self, closure: Closure) -> None:
        """Add a closure; of two that are the same, the one with a measured position counts."""
        before = self.known.get(closure.key)
        if before:
            self.twice += 1
            if before.closure.is_measured or not closure.is_measured:
                return
        self.known[closure.key] = Known(closure)

    @property
    def drives(self) -> list[Odometry]:
        """All drives; the last one is running."""
        return [*self.earlier, self.running]

    @property
    def correction(self) -> Matrix | None:
        """The pose (4, 4) of the frame of odometry in that of the map; None if it is unknown."""
        if self._is_paused or not (self._is_aligned and self.running.keyframes):
            return None
        return np.asarray(self._move @ self.running.bridge)

    @property
    def sigmas(self) -> tuple[float, float]:
        """
        The standard deviations of where the correction has the robot now, metres and radians.

        They are of the last solution, of what was driven since, and of what the newest closure
        contradicts if it is refused; infinite while the correction is unknown.
        """
        if self.correction is None:
            return math.inf, math.inf
        moved, since = self.running.since(self._solved)
        variances = moved_covariance(self._spread, moved) + since
        metres2, radians2 = (
            float(np.linalg.eigvalsh(variances[part, part]).max())
            for part in (slice(0, 3), slice(3, 6))
        )
        for one in self._refused[:1]:
            metres2, radians2 = metres2 + one.apart_m**2, radians2 + one.apart_rad**2
        return math.sqrt(metres2), math.sqrt(radians2)

    def problem(self, again: bool = False) -> Problem | None:
        """Return what is to be solved; None if there is nothing new, unless it is solved again."""
        unplaced = [one for one in self.known.values() if one.edge is None]
        for one in unplaced[: -LIVE.most_waiting]:
            self.without_place += one.kept is None
            del self.known[one.closure.key]
        if not self.running.keyframes:
            return None
        waiting = [one for one in self.known.values() if one.edge is None and one.kept is None]
        found = [(one, places) for one in waiting if (places := self._places(one))]
        if not (again or found or self.is_breaking):
            return None
        self.nodes = self.nodes or {MAP: np.eye(4)}
        stored = set[int]() if self._nodes else {*self.nodes}
        new = self._extend({query[0] for _, (_, _, query) in found} | stored)
        for one, places in found:
            one.edge, self.apart_ns = self._link(*places), None
        ends = [(one.edge.end, one) for one, _ in found if one.edge]
        for _, one in sorted(ends, key=lambda end: end[0]):
            self._carried.add(one)
        if not again:
            self._loosen()
        links = [one for one in self.known.values() if one.edge]
        held = {drive.first: LIVE.loose for drive in self.drives}
        if self.earlier or not any(one.edge and one.edge.start == MAP for one in links):
            held[1] = ROBUST.held
        held[MAP], steps = ROBUST.held, [*self._steps]
        return Problem(new, self.poses, steps, links, held, self.running.first, self._solver)

    @property
    def is_breaking(self) -> bool:
        """Whether closures say that odometry breaks elsewhere than it was loosened."""
        return self._carried.breaks().keys() != self.running.breaks

    def _loosen(self) -> None:
        """Let odometry break where closures say so, and nowhere else; such a graph is new."""
        drive, breaks = self.running, self._carried.breaks()
        changed = breaks.keys() ^ drive.breaks
        if not changed:
            return
        nodes, drive.breaks = self.poses(), {*breaks}
        for keyframe in sorted(changed):
            at = bisect_left(self._nodes, keyframe)
            before, node = self._nodes[at - 1], self._nodes[at]
            moved = nodes[before] @ drive.step(before, node).moved
            if one := breaks.get(keyframe):  # what follows is where its first closure says
                moved = nodes[one.start] @ one.moved @ inverse(nodes[one.end]) @ nodes[node]
            move = moved @ inverse(nodes[node])
            nodes |= {after: move @ nodes[after] for after in self._nodes[at:]}
        self._steps = [
            drive.edge(*step.ends) if step.start >= drive.first else step for step in self._steps
        ]
        self._solver = Solver()

    def _pose(self, node: int) -> Matrix:
        """Return the pose (4, 4) of a node, as it was solved last."""
        pose = self._solver.pose(node)
        return self.nodes[node] if pose is None else pose

    def _extend(self, wanted: set[int]) -> dict[int, Matrix]:
        """Make nodes of new keyframes; `wanted` ones are nodes in any case."""
        found = dict[int, Matrix]()
        for drive in self.drives:
            first, end = drive.nodes.start, drive.nodes.stop
            old = self._nodes[bisect_left(self._nodes, first) : bisect_left(self._nodes, end)]
            least, new = old[-1] if old else first - 1, list[int]()
            for node in range(least + 1, end):
                number = node - first
                if number < LIVE.fine or not number % LIVE.every or node in wanted:
                    new.append(node)
            fresh = [node for node in new if node not in self.nodes]
            if drive is self.running:
                poses = [self._move @ drive.keyframe(node) for node in fresh]
            else:
                poses = [*self.corrected(drive, fresh)]
            found |= dict(zip(fresh, poses, strict=True))
            ends = pairwise([*old[-1:], *new])
            self._steps += [drive.edge(*both) for both in ends]
            self._nodes += new
        self.nodes |= found
        return found

    def poses(self) -> dict[int, Matrix]:
        """Return the poses (4, 4) of all nodes, as they were solved last."""
        if solution := self._solution:
            self.nodes |= solution.poses
            self._solution = None
        return self.nodes

    def adopt(self, problem: Problem, solution: Solution) -> list[Known]:
        """Take over a solution; return closures that it newly refuses, or accepts after all."""
        if problem.solver is not self._solver:
            return []  # the drive began anew
        changed = []
        first = problem.first
        for one, kept, error in zip(problem.links, solution.kept, solution.errors, strict=True):
            one.error, edge = error, one.edge
            if edge and one.kept is not kept:
                if one.kept is False or not kept:
                    changed.append(one)
                one.kept = kept
                there = solution.pose(edge.start) @ edge.moved
                off = inverse(there) @ solution.pose(edge.end)
                one.apart_m = float(np.linalg.norm(off[:3, 3]))
                one.apart_rad = angle(off[:3, :3])
        ends = [one.edge for one in problem.links if one.edge and one.kept]
        outside = sum(edge.end >= first > edge.start for edge in ends)
        self._is_aligned |= outside >= LIVE.agreeing
        self._solution = solution
        if (node := self._nodes[-1]) >= first:
            self._move = solution.pose(node) @ inverse(self.running.keyframe(node))
            if solution.spread is not None:
                self._solved, self._spread = node, solution.spread
        return changed

    def corrected(self, drive: Odometry, asked: Sequence[int] | None = None) -> Matrix:
        """Return the poses (n, 4, 4) of a drive's keyframes, by default of all."""
        return drive.corrected(self.poses(), asked)

    @property
    def counts(self) -> dict[str, Any]:
        """The size of the graph and what became of its closures, for diagnostics."""
        solved = [one for one in self.known.values() if one.edge and one.kept is not None]
        kept = [one for one in solved if one.kept]
        keyframes = sum(len(drive.keyframes) for drive in self.drives)
        metres, radians = self.sigmas
        return {
            'keyframes': len(self.running.keyframes),
            'edges': max(0, keyframes - len(self.drives)) + len(kept),
            'kept': len(kept),
            'refused': len(solved) - len(kept),
            'waiting': sum(one.kept is None for one in self.known.values()),
            'without_place': self.without_place,
            'twice': self.twice,
            'odometry_resets': self.running.resets,
            'clock_jumps': self.restarts,
            'carried': len(self.running.breaks),
            'contradicting': self.contradicting,
            'largest_residual': max((one.error for one in kept), default=0.0),
            'in_map': self._is_aligned,
            'map_to_odom_sigma_m': metres,
            'map_to_odom_sigma_rad': radians,
        }

    @property
    def contradicting(self) -> int:
        """How many of the newest closures in a row are refused."""
        return len(self._refused)

    @property
    def _refused(self) -> list[Known]:
        """The newest closures, newest first, up to one that is kept."""
        solved = [
            one
            for one in self.known.values()
            if one.edge and one.kept is not None and one.edge.end >= self.running.first
        ]
        solved.sort(key=lambda one: one.closure.query_ns, reverse=True)
        return [*takewhile(lambda one: not one.kept, solved)]

    def lose(self) -> None:
        """Take note that the robot is lost: its odometry may break here."""
        self.running.hints.append(self.running.nodes.stop)

    def _places(self, one: Known) -> tuple[Closure, Place, Place] | None:
        """Return a closure as it is used, with its reference and query; None if one is unknown."""
        found = self.running.place(one.closure.query_ns)
        closure, reference = self._references.of(one.closure, self.drives)
        if found and reference and found[0] != reference[0]:
            return closure, reference, found
        first_ns, newest_ns = self.running.stamps[0], self.running.stamps[-1]
        if max(first_ns - closure.query_ns, closure.query_ns - newest_ns) > LIVE.patience_ns:
            self.apart_ns = closure.query_ns, newest_ns
        if closure.query_ns < first_ns or newest_ns - closure.query_ns > LIVE.patience_ns:
            one.kept = False
            ends = closure.key[::2]
            is_again = not closure.session and any(
                key[1] and key[::2] == ends for key in self.known
            )
            self.twice += is_again
            self.without_place += not is_again
        return None

    def _link(self, closure: Closure, reference: Place, query: Place) -> Edge:
        """Return a closure as an edge between the nodes before its reference and its query."""
        start, forth, more = self._node(*reference)
        end, back, rest = self._node(*query)
        edge = link_edge(start, end, closure.moved, closure.covariance + more + rest)
        return replace(edge, moved=forth @ closure.moved @ inverse(back))

    def _node(self, keyframe: int, since: Matrix) -> tuple[int, Matrix, Matrix]:
        """Return the node before a place, and the pose (4, 4) since it, with its covariance."""
        if keyframe == MAP:
            return MAP, since, np.zeros((6, 6))
        drive = next(one for one in reversed(self.drives) if one.first <= keyframe)
        node = self._nodes[bisect_right(self._nodes, keyframe) - 1]
        step = drive.edge(node, keyframe)
        return node, step.moved @ since, step.covariance
