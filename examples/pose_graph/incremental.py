# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Updates the same graph keyframe by keyframe with iSAM2."""

from collections.abc import Sequence

from graph import Closure, closure_factor, Noise, Odometry, odometry_factor, Pose, pose_of
import gtsam
import numpy as np
import numpy.typing as npt

# Residual, in standard deviations, beyond which a closure's pull stays constant; 95 % efficient.
_HUBER = 1.345
# Gauss-Newton steps after new closures; the first closure may bend the entire path.
_ROUNDS = 4


class Incremental:
    """
    Adds odometry and accepted closures to the graph.

    A Huber kernel bounds the pull of a closure but rejects none, so pass the closures that
    `graph.optimise` kept. If a closure is no longer kept, the graph is rebuilt.
    """

    def __init__(self, noise: Noise | None = None) -> None:
        self._noise = noise or Noise()
        self._begin()

    def update(self, odometry: Odometry, closures: Sequence[Closure]) -> None:
        """Add new keyframes and closures; closures outside the odometry wait."""
        if not set(self._taken) <= {closure[:2] for closure in closures}:
            self._begin()
        poses = [gtsam.Pose2(*pose) for pose in odometry.keyframes]
        graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
        guess = self._correction
        for index in range(self._count, len(poses)):
            graph.add(odometry_factor(poses, index, self._noise))
            initial.insert(index, guess.compose(poses[index]))
        self._count, before = len(poses), len(self._taken)
        for closure in closures:
            if closure[:2] not in self._taken:
                factor = closure_factor(odometry, closure, self._noise)
                if factor is not None:
                    graph.add(_bounded(factor))
                    self._taken.add(closure[:2])
        if not graph.size():
            return
        self._isam.update(graph, initial)
        for _ in range(_ROUNDS if len(self._taken) > before else 0):
            self._isam.update()
        estimate = self._isam.calculateEstimate()
        self._path = np.array([pose_of(estimate.atPose2(index)) for index in range(len(poses))])
        self._correction = gtsam.Pose2(*self._path[-1]).compose(poses[-1].inverse())

    @property
    def path(self) -> npt.NDArray[np.float64]:
        """The poses of the keyframes: x, y, yaw, (N, 3)."""
        return self._path

    @property
    def correction(self) -> Pose:
        """The pose of the odometry frame in the map frame: the transform map -> odom."""
        return pose_of(self._correction)

    def _begin(self) -> None:
        parameters = gtsam.ISAM2Params()
        # The first closure moves all poses, so the linearisation point must move too.
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
