# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Corrects the path of odometry with loop closures, with the solver of `convseq map link`.

A record is a file with the inputs of a graph, from which the graph can be rebuilt.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
import json
import math
from pathlib import Path
from typing import NamedTuple

from convseq_ros.io.regular_file import complete_or_absent
from convseq_ros.pose_graph.optimisation import gnc_fit
import gtsam
import numpy as np
import numpy.typing as npt

_HELD = (1e-3, 1e-3, 1e-4)
_NEWEST_NS = 200_000_000
# Smallest standard deviations of a measured closure: errors of neighbours are correlated.
_FINEST = (0.1, 0.1, 0.01)


class Pose(NamedTuple):
    """Metres and radians, counter-clockwise; x forward, y left."""

    x: float
    y: float
    yaw: float


class Closure(NamedTuple):
    """Two times at which the robot was at the same place; None for missing measurements."""

    query_ns: int  # the later one
    reference_ns: int
    turn_rad: float | None = None  # turn since the reference, to the left
    measured: Pose | None = None  # the query's pose relative to the reference
    covariance: Sequence[float] | None = None  # 9 numbers: of x, y and yaw, row by row


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of the measurements in the graph."""

    odometry_m: float = 0.05  # after 1 m; it grows with the square root of the distance
    odometry_rad: float = 0.01  # likewise
    # Of a closure's position, along and across. It covers the spacing of places, matches that are
    # off by one or two frames, and the width of a lane.
    closure_m: float = 1.5
    closure_rad: float = 0.15  # of its heading, if only assumed to be the same
    turn_rad: float = 0.05  # of its heading, if measured
    # A closure is kept if its residual is within this quantile of right closures.
    inlier_probability: float = 0.99


@dataclass(frozen=True, slots=True)
class Solution:
    """The poses of the keyframes; both paths begin at the first odometry."""

    stamps_ns: npt.NDArray[np.int64]  # (N,)
    before: npt.NDArray[np.float64]  # (N, 3): x, y, yaw by odometry alone
    after: npt.NDArray[np.float64]  # (N, 3), corrected
    # For each closure, whether the corrected path agrees; False outside the odometry.
    kept: tuple[bool, ...]


class Odometry:
    """
    The poses of odometry over time; some are keyframes, the nodes of the graph.

    A keyframe is added after a distance in metres or a turn in radians.
    """

    def __init__(self, keyframe_distance_m: float = 2.0, keyframe_turn_rad: float = 0.35) -> None:
        self._distance_m, self._turn_rad = keyframe_distance_m, keyframe_turn_rad
        self._stamps: list[int] = []
        self._poses: list[Pose] = []
        self._keyframes: list[int] = []

    def __len__(self) -> int:
        return len(self._keyframes)

    @property
    def measured(self) -> list[tuple[int, Pose]]:
        """All added stamps in nanoseconds, and poses."""
        return list(zip(self._stamps, self._poses, strict=True))

    @property
    def stamps_ns(self) -> list[int]:
        """Stamps of the keyframes."""
        return [self._stamps[index] for index in self._keyframes]

    @property
    def keyframes(self) -> list[Pose]:
        """Poses of the keyframes."""
        return [self._poses[index] for index in self._keyframes]

    def add(self, stamp_ns: int, pose: Pose) -> bool:
        """Append a pose, and return whether it became a keyframe; late poses are ignored."""
        if self._stamps and stamp_ns <= self._stamps[-1]:
            return False
        self._stamps.append(stamp_ns)
        self._poses.append(pose)
        if self._keyframes:
            last = self._poses[self._keyframes[-1]]
            turned = math.remainder(pose.yaw - last.yaw, 2 * math.pi)
            if math.dist(pose[:2], last[:2]) < self._distance_m and abs(turned) < self._turn_rad:
                return False
        self._keyframes.append(len(self._stamps) - 1)
        return True

    def at(self, stamp_ns: int) -> Pose | None:
        """Return the interpolated pose at a time, or the last pose up to 0.2 s after it."""
        after = bisect_right(self._stamps, stamp_ns)
        if not after or stamp_ns - self._stamps[-1] > _NEWEST_NS:
            return None
        if after == len(self._stamps):
            return self._poses[-1]
        first, second = self._poses[after - 1], self._poses[after]
        span = self._stamps[after] - self._stamps[after - 1]
        share = (stamp_ns - self._stamps[after - 1]) / span
        return Pose(
            first.x + share * (second.x - first.x),
            first.y + share * (second.y - first.y),
            first.yaw + share * math.remainder(second.yaw - first.yaw, 2 * math.pi),
        )

    def place(self, stamp_ns: int) -> tuple[int, gtsam.Pose2] | None:
        """Return the index of the last keyframe before a time, and the relative pose since."""
        pose = self.at(stamp_ns)
        if pose is None:
            return None
        index = bisect_right(self._keyframes, bisect_right(self._stamps, stamp_ns) - 1) - 1
        return index, gtsam.Pose2(*self.keyframes[index]).between(gtsam.Pose2(*pose))


def optimise(
    odometry: Odometry,
    closures: Sequence[Closure],
    noise: Noise | None = None,
    robust: bool = True,
) -> Solution:
    """
    Return the path that fits the odometry and the closures best.

    A measured closure constrains the relative pose of two places. Any other closure constrains
    them to the same position, and to the measured or the same heading. `gnc_fit` selects the
    closures to keep; without `robust`, Levenberg-Marquardt uses all. Odometry is always used.
    Closures outside the odometry are left out. ValueError if there is no odometry.
    """
    noise = noise or Noise()
    poses = [gtsam.Pose2(*pose) for pose in odometry.keyframes]
    if not poses:
        raise ValueError('there is no odometry to optimise')
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for index, pose in enumerate(poses):
        graph.add(odometry_factor(poses, index, noise))
        initial.insert(index, pose)
    fixed = graph.size()
    used = []
    for number, closure in enumerate(closures):
        factor = closure_factor(odometry, closure, noise)
        if factor is not None:
            used.append(number)
            graph.add(factor)
    result, inliers = initial, [True] * len(used)
    if used and robust:
        result, inliers = gnc_fit(graph, initial, fixed, noise.inlier_probability)
    elif used:
        result = gtsam.LevenbergMarquardtOptimizer(graph, initial).optimize()
    kept = [False] * len(closures)
    for number, inlier in zip(used, inliers, strict=True):
        kept[number] = inlier
    after = [result.atPose2(index) for index in range(len(poses))]
    return Solution(
        np.array(odometry.stamps_ns, np.int64),
        np.array(odometry.keyframes),
        np.array([pose_of(pose) for pose in after]),
        tuple(kept),
    )


def odometry_factor(
    poses: Sequence[gtsam.Pose2], index: int, noise: Noise
) -> gtsam.NonlinearFactor:
    """Return the factor from the previous keyframe, or the prior of the first keyframe."""
    if not index:
        return gtsam.PriorFactorPose2(0, poses[0], _sigmas(*_HELD))
    step = poses[index - 1].between(poses[index])
    root = math.sqrt(max(0.1, math.hypot(step.x(), step.y())))
    along, turn = noise.odometry_m * root, noise.odometry_rad * root
    return gtsam.BetweenFactorPose2(index - 1, index, step, _sigmas(along, along, turn))


def closure_factor(
    odometry: Odometry, closure: Closure, noise: Noise
) -> gtsam.BetweenFactorPose2 | None:
    """Return the factor between the keyframes before both times; None if there is none."""
    reference, query = odometry.place(closure.reference_ns), odometry.place(closure.query_ns)
    if reference is None or query is None or reference[0] == query[0]:
        return None
    if closure.measured is not None and closure.covariance is not None:
        apart = gtsam.Pose2(*closure.measured)
        floor = np.diag(np.square(_FINEST))
        matrix = np.reshape(closure.covariance, (3, 3)) + floor
        model = gtsam.noiseModel.Gaussian.Covariance(matrix)
    else:
        apart = gtsam.Pose2(0.0, 0.0, closure.turn_rad or 0.0)
        heading = noise.closure_rad if closure.turn_rad is None else noise.turn_rad
        model = _sigmas(noise.closure_m, noise.closure_m, heading)
    between = reference[1].compose(apart).compose(query[1].inverse())
    return gtsam.BetweenFactorPose2(reference[0], query[0], between, model)


def pose_of(pose: gtsam.Pose2) -> Pose:
    return Pose(pose.x(), pose.y(), pose.theta())


def _sigmas(*values: float) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))


def micro(stamp_ns: int) -> int:
    """Return microseconds, the precision of seconds in a float64."""
    return round(stamp_ns / 1000)


def write_record(
    path: Path, odometry: Odometry, closures: Sequence[Closure], kept: Sequence[bool]
) -> None:
    """Write all odometry, all closures and whether they were kept, in one step."""
    record = {
        'odometry': [[stamp_ns, *pose] for stamp_ns, pose in odometry.measured],
        'closures': closures,
        'kept': kept,
    }
    with complete_or_absent(path) as part:
        part.write_text(json.dumps(record))


def read_record(path: Path) -> tuple[list[tuple[int, Pose]], list[Closure], list[bool]]:
    """Return stamped odometry, closures, and whether each closure was kept."""
    record = json.loads(path.read_text())
    odometry = [(stamp_ns, Pose(*pose)) for stamp_ns, *pose in record['odometry']]
    closures = [
        Closure(*times, turn_rad, measured and Pose(*measured), covariance and tuple(covariance))
        for *times, turn_rad, measured, covariance in record['closures']
    ]
    return odometry, closures, record['kept']
