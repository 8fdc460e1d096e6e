# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The odometry of one drive over time; some of its poses are keyframes."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import replace
import math

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.map.online import RECENT
from convseq_ros.core.rigid import angle, difference, inverse, Matrix, motion
from convseq_ros.core.types import constants, Doubles
from convseq_ros.pose_graph.edges import Edge
import numpy as np


@constants
class ODOMETRY:
    """Limits of odometry; engineering, not studied."""

    turn_rad: float = 0.35  # after which a keyframe is made
    thinned_m: float = 0.1  # poses closer than this, and than `thinned_rad`, are not kept
    thinned_rad: float = 0.03
    fastest_mps: float = 50.0  # a faster motion is a reset, ...
    fastest_radps: float = 10.0
    excused_m: float = 1.0  # ... beyond this
    excused_rad: float = 0.5
    lost_m: float = 5.0  # standard deviations of the motion during a reset
    lost_rad: float = 1.0
    carried_m: float = 1e3  # standard deviations of the motion where closures contradict it
    carried_rad: float = 3.0
    told_m: float = 0.01  # least standard deviation that is believed, after a metre driven, ...
    told_rad: float = 0.005
    told_of_turn: float = 0.02  # ... and after a radian turned; at most that of a reset
    jump_back_ns: int = 1_000_000_000  # a clock that goes back further begins anew
    faster: float = 2.0  # than before, at most, in a pause


class Odometry:
    """
    Poses of a drive, continuous in a frame of their own, and the keyframes among them.

    Keyframes are named by their nodes in a graph, from `first` on.

    When odometry is reset, the robot stays where it is: `bridge` (4, 4) is the pose of the frame
    of odometry, as it is now, in the frame of the drive. `spread` are the variances of the
    keyframes, position (m2) and heading (rad2), since the start of the drive. Before the nodes in
    `breaks` the motion is unknown; before those in `hints` it may be.
    """

    def __init__(self, config: PoseGraphConfig, first: int = 1) -> None:
        self.first = first
        self.sessions = set[str]()  # ids of those of the map that it makes: one for each start
        self.bridge, self.resets = np.eye(4), 0
        self.stamps, self.poses, self.keyframes = list[int](), list[Matrix](), list[int]()
        self.spread, self.breaks, self.hints = list[tuple[float, float]](), set[int](), list[int]()
        self._config, self._fastest_mps = config, 0.0
        self._raw = self._newest = self._last_keyframe = np.eye(4)
        self._is_passing = False  # whether the next pose replaces the newest one
        self._distance_m = self._lost_m2 = self._lost_rad2 = 0.0
        self._told: tuple[float, float] | None = None  # variances of the last keyframe's message

    @property
    def nodes(self) -> range:
        """The nodes of the keyframes."""
        return range(self.first, self.first + len(self.keyframes))

    def goes_on(self, stamp_ns: int, raw: Matrix) -> bool:
        """Return whether a pose after a pause may be of this drive: soon, and no further."""
        passed_ns = abs(stamp_ns - self.stamps[-1])
        driven_m = self._fastest_mps * passed_ns / 1e9
        furthest_m = ODOMETRY.faster * driven_m + ODOMETRY.excused_m
        is_near = math.dist(raw[:3, 3], self._raw[:3, 3]) <= furthest_m
        return is_near and passed_ns <= RECENT.paused_ns

    def is_anew(self, stamp_ns: int) -> bool:
        """Return whether the clock was set back: the drive of this pose is another one."""
        return bool(self.stamps) and self.stamps[-1] - stamp_ns > ODOMETRY.jump_back_ns

    def add(self, stamp_ns: int, raw: Matrix, told: tuple[float, float] | None = None) -> bool:
        """
        Append a pose (4, 4) of odometry; return whether it became a keyframe.

        `told` are the variances of position and heading in its message. A late pose is ignored.
        """
        if self.stamps and stamp_ns <= self.stamps[-1]:
            return False
        if self.stamps:
            self._bridge_reset(stamp_ns, raw)
        pose, self._raw = self.bridge @ raw, raw
        if self.poses:
            self._distance_m += math.dist(pose[:3, 3], self._newest[:3, 3])
        if self._is_passing:
            del self.stamps[-1], self.poses[-1]
        self._newest = pose
        self.stamps.append(stamp_ns)
        self.poses.append(pose)
        if is_keyframe := not self.keyframes or self._is_apart(pose):
            self._add_keyframe(pose, told)
        self._is_passing = not is_keyframe and _is_near(
            self.poses[-2], pose, ODOMETRY.thinned_m, ODOMETRY.thinned_rad
        )
        return is_keyframe

    def _bridge_reset(self, stamp_ns: int, raw: Matrix) -> None:
        """Let the drive go on where it was, if odometry jumped; the motion is then unknown."""
        passed_s = (stamp_ns - self.stamps[-1]) / 1e9
        furthest_m = ODOMETRY.fastest_mps * passed_s + ODOMETRY.excused_m
        furthest_rad = ODOMETRY.fastest_radps * passed_s + ODOMETRY.excused_rad
        if not _is_near(self._raw, raw, furthest_m, furthest_rad):
            self.bridge = self.poses[-1] @ inverse(raw)
            self.resets += 1
            self.hints.append(self.nodes.stop)
            self._lost_m2, self._lost_rad2 = ODOMETRY.lost_m**2, ODOMETRY.lost_rad**2
            self._told = None

    def _is_apart(self, pose: Matrix) -> bool:
        distance_m = self._config.graph_spacing_m
        is_near = _is_near(self._last_keyframe, pose, distance_m, ODOMETRY.turn_rad)
        return bool(self._lost_m2) or not is_near

    def _add_keyframe(self, pose: Matrix, told: tuple[float, float] | None) -> None:
        variances = self._lost_m2, self._lost_rad2
        told = told if told and np.isfinite(told).all() else None
        if self.spread:
            metres, radians = self._config.odometry_sigma_m, self._config.odometry_sigma_rad
            passed_s = (self.stamps[-1] - self.stamps[self.keyframes[-1]]) / 1e9
            self._fastest_mps = max(self._fastest_mps, self._distance_m / passed_s)
            distance_m = max(0.1, self._distance_m)
            grown = metres**2 * distance_m, radians**2 * distance_m
            if told and self._told and told[0] > self._told[0] and told[1] > self._told[1]:
                turn_rad = angle(self._last_keyframe[:3, :3].T @ pose[:3, :3])
                least_m2 = ODOMETRY.told_m**2 * distance_m
                least_rad2 = (
                    ODOMETRY.told_rad**2 * distance_m + ODOMETRY.told_of_turn**2 * turn_rad
                )
                grown = (
                    min(max(told[0] - self._told[0], least_m2), ODOMETRY.lost_m**2),
                    min(max(told[1] - self._told[1], least_rad2), ODOMETRY.lost_rad**2),
                )
            metres2, radians2 = self.spread[-1]
            variances = variances[0] + grown[0] + metres2, variances[1] + grown[1] + radians2
        self.spread.append(variances)
        self.keyframes.append(len(self.poses) - 1)
        self._last_keyframe, self._told = pose, told
        self._distance_m = self._lost_m2 = self._lost_rad2 = 0.0

    def at(self, stamp_ns: int) -> Matrix | None:
        """Return the interpolated pose (4, 4) at a time; None if it is outside the drive."""
        after = bisect_right(self.stamps, stamp_ns)
        if not after or stamp_ns > self.stamps[-1]:
            return None
        if after == len(self.stamps):
            return self.poses[-1]
        first, second = self.poses[after - 1], self.poses[after]
        span_ns = self.stamps[after] - self.stamps[after - 1]
        share = (stamp_ns - self.stamps[after - 1]) / span_ns
        return np.asarray(first @ motion(share * difference(first, second)))

    def place(self, stamp_ns: int) -> tuple[int, Matrix] | None:
        """Return the last keyframe before a time, and the pose (4, 4) since it."""
        if (pose := self.at(stamp_ns)) is None:
            return None
        sample = bisect_right(self.stamps, stamp_ns) - 1
        node = self.first + bisect_right(self.keyframes, sample) - 1
        return node, inverse(self.keyframe(node)) @ pose

    def since(self, node: int) -> tuple[Matrix, Matrix]:
        """Return the motion (3,) from a keyframe until now, in its axes, and its covariance."""
        start, later = self.keyframe(node), range(node, self.nodes.stop)
        grown = np.diff(self.variances()[node - self.first :], axis=0)
        places = np.array([self.keyframe(at)[:3, 3] for at in later])
        arms_m = self._newest[:3, 3] - places[:-1]  # on which an error of a heading acts
        metres2, radians2 = grown.sum(axis=0).tolist()
        metres2 += float(grown[:, 1] @ (arms_m**2).sum(axis=1))
        metres2 += self._config.odometry_sigma_m**2 * self._distance_m
        radians2 += self._config.odometry_sigma_rad**2 * self._distance_m
        return inverse(start)[:3] @ self._newest[:, 3], np.diag([metres2] * 3 + [radians2] * 3)

    def keyframe(self, node: int) -> Matrix:
        """Return the pose (4, 4) of a keyframe."""
        return self.poses[self.keyframes[node - self.first]]

    def keyframe_ns(self, node: int) -> int:
        """Return the time of a keyframe."""
        return self.stamps[self.keyframes[node - self.first]]

    def edge(self, start: int, end: int) -> Edge:
        """Return the motion between two keyframes."""
        step = self.step(start, end)
        if not any(start < node <= end for node in self.breaks):
            return step
        unknown = np.diag([ODOMETRY.carried_m**2] * 3 + [ODOMETRY.carried_rad**2] * 3)
        return replace(step, covariance=step.covariance + unknown)

    def variances(self) -> Doubles:
        """Return `spread`, (n, 2), with what is unknown at breaks."""
        numbers = [node - self.first for node in self.breaks]
        broken = np.bincount(numbers, minlength=len(self.spread)).cumsum()
        unknown = np.square((ODOMETRY.carried_m, ODOMETRY.carried_rad))
        return np.reshape(self.spread, (-1, 2)) + broken[:, None] * unknown

    def step(self, start: int, end: int) -> Edge:
        """Return the motion between two keyframes as odometry has it, also across a break."""
        moved = inverse(self.keyframe(start)) @ self.keyframe(end)
        (metres, radians), (more_m2, more_rad2) = (
            self.spread[node - self.first] for node in (start, end)
        )
        turned = more_rad2 - radians
        # An error of the heading half-way moves the end aside.
        position = more_m2 - metres + turned * float(moved[:3, 3] @ moved[:3, 3]) / 3
        covariance = np.diag([position] * 3 + [turned] * 3)
        return Edge(start, end, moved, covariance, False)

    def corrected(self, nodes: Mapping[int, Matrix], asked: Sequence[int] | None = None) -> Matrix:
        """
        Return the corrected poses (n, 4, 4) of keyframes, by default of all.

        `nodes` are those that were solved, (4, 4); between them poses blend.
        """
        wanted = np.array(self.nodes if asked is None else asked, int)
        poses = np.array([self.keyframe(node) for node in wanted.tolist()]).reshape(-1, 4, 4)
        fixed = np.array(sorted(node for node in nodes if node in self.nodes))
        if not len(fixed) or not len(wanted):
            return poses
        after = np.searchsorted(fixed, wanted, 'right')
        ends = np.clip([after - 1, after], 0, len(fixed) - 1)
        used, ends = np.unique(ends.ravel(), return_inverse=True)
        fixed, (before, after) = fixed[used], ends.reshape(2, -1)
        moves = np.array([nodes[at] @ inverse(self.keyframe(at)) for at in fixed.tolist()])
        spread = self.variances().sum(axis=1)
        ends = fixed[before], fixed[after]
        start, end, here = (spread[at - self.first] for at in (*ends, wanted))
        share = ((here - start) / np.maximum(end - start, 1e-12)).clip(0, 1)
        share = share[:, None, None]
        result = (1 - share) * (moves[before] @ poses) + share * (moves[after] @ poses)
        left, _, right = np.linalg.svd(result[:, :3, :3])  # the nearest rotation
        result[:, :3, :3] = left @ right
        return np.asarray(result)


def _is_near(first: Matrix, second: Matrix, metres: float, radians: float) -> bool:
    if math.dist(first[:3, 3], second[:3, 3]) >= metres:
        return False
    return angle(first[:3, :3].T @ second[:3, :3]) < radians
