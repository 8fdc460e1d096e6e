# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A pose graph that grows while a robot drives: odometry, closures, and the corrected way."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
import math
from typing import Any

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.rigid import inverse, Matrix
from convseq_ros.core.types import constants, UNKNOWN_M2
from convseq_ros.pose_graph.alignment import agreed
from convseq_ros.pose_graph.edges import Edge, link_edge
from convseq_ros.pose_graph.odometry import Odometry
from convseq_ros.pose_graph.optimisation import optimise, ROBUST, Solution
import numpy as np

_MAP = 0  # node at the origin of the map, from which absolute poses are measured


@constants
class LIVE:
    """Limits of the growing graph."""

    most_even: int = 500  # keyframes that are solved for beside those of closures, evenly spread
    loose: float = 1e3  # standard deviation of the start of a drive, metres and radians
    patience_ns: int = 10_000_000_000  # until a closure without a counterpart counts as unusable
    most_poses: int = 1000  # absolute poses that wait for their closure


@dataclass(frozen=True, eq=False, slots=True)
class Closure:
    """The pose of a robot at one time, measured from where it was at another."""

    query_ns: int
    reference_ns: int
    moved: Matrix  # (4, 4), pose of the query in the reference's frame
    covariance: Matrix  # (6, 6), in the reference's axes; UNKNOWN_M2 where there is no position
    session: str = ''  # of the reference; empty for the running drive

    @property
    def key(self) -> tuple[int, str, int]:
        """The pair of places; microseconds, as a float64 of seconds tells them."""
        return round(self.query_ns / 1000), self.session, round(self.reference_ns / 1000)

    @property
    def is_measured(self) -> bool:
        """Whether the position is known."""
        return bool(self.covariance[:3, :3].max() < UNKNOWN_M2 / 2)


@dataclass(slots=True)
class Known:
    """What became of a closure."""

    closure: Closure
    edge: Edge | None = None  # None while one of its places is not known
    kept: bool | None = None  # whether the solution agrees; None before it is solved
    kept_before: bool | None = None  # the verdict before the last one
    error: float = 0.0  # in standard deviations
    apart_m: float = 0.0  # distance between the measured and the corrected position


@dataclass(frozen=True, eq=False, slots=True)
class Problem:
    """What is solved at a time; it does not change while the graph grows."""

    edges: list[Edge]
    start: dict[int, Matrix]
    held: dict[int, float]
    links: list[Known]  # in the order of the links among the edges

    def solve(self) -> Solution:
        """Return the robust solution; ConvseqError if GTSAM is not installed."""
        return optimise(self.edges, self.start, self.held)


@dataclass(eq=False)
class PoseGraph:
    """
    Collects odometry and closures; `problem` and `adopt` put a solution, made elsewhere, between.

    New keyframes extend a chain, whose best estimate needs no solver: the last correction moves
    them. The first drive begins where its odometry begins. With `earlier` drives, or poses in the
    frame of a map, the running drive is in their frame from the first closure on.
    """

    config: PoseGraphConfig = field(default_factory=PoseGraphConfig)
    earlier: list[Odometry] = field(default_factory=list)
    known: dict[tuple[int, str, int], Known] = field(default_factory=dict)
    solved: dict[int, Matrix] = field(default_factory=dict)  # (4, 4), by node
    without_place: int = 0  # closures of which a place is not in the graph, nor in the map's frame
    twice: int = 0  # closures that came again
    restarts: int = 0  # clocks that were set back

    def __post_init__(self) -> None:
        self.running = Odometry(self.config)
        self._absolute = dict[int, tuple[Matrix, Matrix]]()
        self._is_aligned = not self.earlier  # whether the running drive is in the frame of the map
        self._move = np.eye(4)  # correction of its newest keyframe

    def add_odometry(
        self, stamp_ns: int, pose: Matrix, told: tuple[float, float] | None = None
    ) -> None:
        """Add a pose (4, 4) of odometry; `told` are its variances, of position and heading."""
        if self.running.is_anew(stamp_ns):
            self.restarts += 1
            first = self._first(self.running)
            self.solved = {node: at for node, at in self.solved.items() if node < first}
            self.known = {key: one for key, one in self.known.items() if _ends_before(one, first)}
            self.running = Odometry(self.config)
            self._is_aligned, self._move = not self.earlier, np.eye(4)
        self.running.add(stamp_ns, pose, told)

    def add_closure(self, closure: Closure) -> None:
        """Add a closure; of two that are the same, the one with a measured position counts."""
        before = self.known.get(closure.key)
        if before:
            self.twice += 1
            if before.closure.is_measured or not closure.is_measured:
                return
        self.known[closure.key] = Known(closure)

    def add_pose(self, query_ns: int, pose: Matrix, covariance: Matrix) -> None:
        """Add a pose in the frame of the map, for a closure whose place is not in the graph."""
        self._absolute[query_ns] = pose, covariance
        if len(self._absolute) > LIVE.most_poses:
            del self._absolute[next(iter(self._absolute))]

    @property
    def drives(self) -> list[Odometry]:
        """All drives; the last one is running."""
        return [*self.earlier, self.running]

    @property
    def correction(self) -> Matrix | None:
        """The pose (4, 4) of the frame of odometry in that of the map; None if it is unknown."""
        if not (self._is_aligned and self.running.keyframes):
            return None
        return np.asarray(self._move @ self.running.bridge)

    def problem(self) -> Problem | None:
        """Return what is to be solved; None if no new closure has both its places."""
        if not self.running.keyframes:
            return None
        waiting = [one for one in self.known.values() if one.edge is None and one.kept is None]
        if not any([self._find(one) for one in waiting]):
            return None
        links = [one for one in self.known.values() if one.edge]
        edges = [one.edge for one in links if one.edge]
        ends = {node for edge in edges for node in (edge.start, edge.end)}
        start, held = {_MAP: np.eye(4)}, {_MAP: ROBUST.held}
        total = sum(len(drive.keyframes) for drive in self.drives)
        step = max(1, math.ceil(total / LIVE.most_even))
        for drive in self.drives:
            first, count = self._first(drive), len(drive.keyframes)
            inside = {node - first for node in ends if first <= node < first + count}
            chosen = sorted(inside | {*range(0, count, step), count - 1})
            poses = self.corrected(drive, chosen)
            start |= {first + at: pose for at, pose in zip(chosen, poses, strict=True)}
            is_origin = first == 1 and (bool(self.earlier) or _MAP not in ends)
            held[first] = ROBUST.held if is_origin else LIVE.loose
            edges += [drive.edge(a, b, first) for a, b in pairwise(chosen)]
        self._align(links, start)
        return Problem(edges, start, held, links)

    def adopt(self, problem: Problem, solution: Solution) -> list[Known]:
        """Take over a solution; return the closures on which the verdict is new."""
        changed = []
        first, poses = self._first(self.running), solution.poses
        for one, kept, error in zip(problem.links, solution.kept, solution.errors, strict=True):
            edge = one.edge
            if edge is None or self.known.get(one.closure.key) is not one:
                continue
            if one.kept is not kept:
                changed.append(one)
            one.kept_before, one.kept, one.error = one.kept, kept, error
            there = poses[edge.start] @ edge.moved
            one.apart_m = math.dist(there[:3, 3], poses[edge.end][:3, 3])
            self._is_aligned |= kept and edge.end >= first > edge.start
        self.solved = poses
        if (node := max(poses)) >= first:
            self._move = poses[node] @ inverse(self.running.keyframe(node - first))
        return changed

    def corrected(self, drive: Odometry, numbers: Sequence[int] | None = None) -> Matrix:
        """Return the poses (n, 4, 4) of a drive's keyframes; between solved ones they blend."""
        first, count = self._first(drive), len(drive.keyframes)
        wanted = np.arange(count) if numbers is None else np.array(numbers)
        poses = np.array([drive.keyframe(int(at)) for at in wanted]).reshape(-1, 4, 4)
        fixed = np.array(sorted(n - first for n in self.solved if first <= n < first + count))
        if not len(fixed):
            return poses
        moves = np.array(
            [self.solved[first + at] @ inverse(drive.keyframe(int(at))) for at in fixed]
        )
        after = np.searchsorted(fixed, wanted, 'right')
        before, after = (np.clip(at, 0, len(fixed) - 1) for at in (after - 1, after))
        spread = np.array(drive.spread).sum(axis=1)
        starts, ends = spread[fixed[before]], spread[fixed[after]]
        share = ((spread[wanted] - starts) / np.maximum(ends - starts, 1e-12)).clip(0, 1)
        share = share[:, None, None]
        result = (1 - share) * (moves[before] @ poses) + share * (moves[after] @ poses)
        left, _, right = np.linalg.svd(result[:, :3, :3])  # the nearest rotation
        result[:, :3, :3] = left @ right
        return np.asarray(result)

    @property
    def counts(self) -> dict[str, Any]:
        """The size of the graph and what became of its closures, for diagnostics."""
        solved = [one for one in self.known.values() if one.edge and one.kept is not None]
        kept = [one for one in solved if one.kept]
        keyframes = sum(len(drive.keyframes) for drive in self.drives)
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
            'largest_residual': max((one.error for one in kept), default=0.0),
            'in_map': self._is_aligned,
        }

    def whole(self) -> tuple[dict[int, Matrix], list[Edge]]:
        """Return the corrected keyframes of all drives by node, and all edges that count."""
        poses, edges = dict[int, Matrix](), list[Edge]()
        for drive in self.drives:
            first, count = self._first(drive), len(drive.keyframes)
            poses |= {first + at: pose for at, pose in enumerate(self.corrected(drive))}
            edges += [drive.edge(at, at + 1, first) for at in range(count - 1)]
        kept = (one.edge for one in self.known.values() if one.edge and one.kept)
        return poses, [*edges, *(edge for edge in kept if edge.start in poses)]

    def _first(self, drive: Odometry) -> int:
        """Return the node of a drive's first keyframe."""
        drives = self.drives
        return 1 + sum(len(one.keyframes) for one in drives[: drives.index(drive)])

    def _find(self, one: Known) -> bool:
        """Find both places of a closure; return whether that has just been done."""
        closure = one.closure
        query = self.running.place(closure.query_ns)
        reference = self._reference(closure)
        moved, covariance = closure.moved, closure.covariance
        if reference is None and closure.query_ns in self._absolute:
            moved, covariance = self._absolute[closure.query_ns]
            reference = _MAP, np.eye(4)
        elif not closure.is_measured:
            moved, covariance = moved.copy(), covariance.copy()
            moved[:3, 3] = covariance[:3] = covariance[:, :3] = 0
            covariance[:3, :3] = np.eye(3) * self.config.closure_sigma_m**2
        node = self._first(self.running) + (query[0] if query else 0)
        if query is None or reference is None or reference[0] == node:
            first_ns, newest_ns = self.running.stamps[0], self.running.stamps[-1]
            is_too_early = closure.query_ns < first_ns
            if is_too_early or newest_ns - closure.query_ns > LIVE.patience_ns:
                one.kept = False
                self.without_place += 1
            return False
        edge = link_edge(reference[0], node, moved, covariance)
        between = reference[1] @ moved @ inverse(query[1])
        one.edge = replace(edge, moved=between)
        return True

    def _reference(self, closure: Closure) -> tuple[int, Matrix] | None:
        """Return the node before the reference of a closure, and the pose (4, 4) since it."""
        for drive in self.drives:
            is_running = drive is self.running and not closure.session
            if is_running or (closure.session and drive.session == closure.session):
                place = drive.place(closure.reference_ns)
                return place and (self._first(drive) + place[0], place[1])
        return None

    def _align(self, links: list[Known], start: dict[int, Matrix]) -> None:
        """Move the running drive to where most closures with earlier places see it."""
        first = self._first(self.running)
        pairs = [
            (start[edge.start] @ edge.moved, start[edge.end])
            for one in links
            if (edge := one.edge) and edge.end >= first > edge.start
        ]
        if pairs:
            move = agreed(pairs)
            start |= {node: move @ pose for node, pose in start.items() if node >= first}


def _ends_before(one: Known, first: int) -> bool:
    return one.edge is not None and one.edge.end < first
