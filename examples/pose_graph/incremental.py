# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The same graph kept up to date keyframe by keyframe: iSAM2."""

from collections.abc import Sequence

from graph import Closure, closure_factor, Noise, Odometry, odometry_factor, Pose, pose_of
import gtsam
import numpy as np
import numpy.typing as npt

# Beyond so many standard deviations a closure pulls no harder; 95 % as good as least squares.
_HUBER = 1.345
# Steps after new closures: each is one of Gauss and Newton, and the first may bend the whole path.
_ROUNDS = 4


class Incremental:
    """
    Follows odometry, and takes in closures that something else believed.

    A Huber kernel bounds how hard one closure pulls; it rejects none, so give it those that
    `graph.optimise` kept. When one of them is kept no longer, the graph is made anew.
    """

    def __init__(self, noise: Noise | None = None) -> None:
        self._noise = noise or Noise()
        self._begin()

    def update(self, odometry: Odometry, believed: Sequence[Closure]) -> None:
        """Take in the keyframes that are new, and closures; those outside the odometry wait."""
        if not set(self._taken) <= {closure[:2] for closure in believed}:
            self._begin()
        poses = [gtsam.Pose2(*pose) for pose in odometry.keyframes]
        graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
        guess = self._correction
        for index in range(self._count, len(poses)):
            graph.add(odometry_factor(poses, index, self._noise))
            initial.insert(index, guess.compose(poses[index]))
        self._count, known = len(poses), len(self._taken)
        for closure in believed:
            if closure[:2] not in self._taken:
                factor = closure_factor(odometry, closure, self._noise)
                if factor is not None:
                    graph.add(_bounded(factor))
                    self._taken.add(closure[:2])
        if not graph.size():
            return
        self._isam.update(graph, initial)
        for _ in range(_ROUNDS if len(self._taken) > known else 0):
            self._isam.update()
        estimate = self._isam.calculateEstimate()
        self._path = np.array([pose_of(estimate.atPose2(index)) for index in range(len(poses))])
        self._correction = gtsam.Pose2(*self._path[-1]).compose(poses[-1].inverse())

    @property
    def path(self) -> npt.NDArray[np.float64]:
        """Where the robot was at its keyframes: x, y, yaw, shape (N, 3)."""
        return self._path

    @property
    def correction(self) -> Pose:
        """Where the odometry's frame is in the map's: what map -> odom would be."""
        return pose_of(self._correction)

    def _begin(self) -> None:
        parameters = gtsam.ISAM2Params()
        # A first closure moves everything: the point at which the graph is linear, too.
        parameters.setRelinearizeThreshold(0.01)
        parameters.relinearizeSkip = 1
        self._isam = gtsam.ISAM2(parameters)
        self._count = 0
        self._taken: set[tuple[int, int]] = set()
        self._path = np.zeros((0, 3))
        self._correction = gtsam.Pose2()


def _bounded(factor: gtsam.BetweenFactorPose2) -> gtsam.BetweenFactorPose2:
    kernel = gtsam.noiseModel.mEstimator.Huber.Create(_HUBER)
    model = gtsam.noiseModel.Robust.Create(kernel, factor.noiseModel())
    return gtsam.BetweenFactorPose2(*factor.keys(), factor.measured(), model)
