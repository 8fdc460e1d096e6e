# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The same graph in kiss-slam's optimiser, without its laser scans: `pip install kiss-slam`."""

from collections.abc import Sequence
from contextlib import redirect_stdout
import io
import math

from graph import Closure, closure_factor, Noise, Odometry, odometry_factor
import gtsam
from kiss_slam.config.config import PoseGraphOptimizerConfig
from kiss_slam.pose_graph_optimizer import PoseGraphOptimizer
import numpy as np
import numpy.typing as npt

_LEVEL = 1e-3  # standard deviation of z, roll and pitch, metres and radians: the town is flat
# Its optimiser, g2o, measures turns by the vector of the quaternion: half the angle.
_OF_TURN = 4.0


def optimise_with_kiss(
    odometry: Odometry, closures: Sequence[Closure], noise: Noise | None = None
) -> npt.NDArray[np.float64]:
    """
    Return x, y and yaw of the keyframes, shape (N, 3), by odometry and all closures.

    It believes every closure: give it those that `graph.optimise` kept.
    """
    noise = noise or Noise()
    poses = [gtsam.Pose2(*pose) for pose in odometry.keyframes]
    optimizer = PoseGraphOptimizer(PoseGraphOptimizerConfig())
    for index, pose in enumerate(poses):
        optimizer.add_variable(index, _matrix(pose))
    optimizer.fix_variable(0)
    factors = [odometry_factor(poses, index, noise) for index in range(1, len(poses))]
    factors += [closure_factor(odometry, closure, noise) for closure in closures]
    for factor in factors:
        if factor is not None:
            before, after = factor.keys()
            optimizer.add_factor(
                after, before, _matrix(factor.measured()), _information(factor.noiseModel())
            )
    with redirect_stdout(io.StringIO()):
        optimizer.optimize()
    found = optimizer.estimates()
    return np.array([_planar(found[index]) for index in range(len(poses))])


def _matrix(pose: gtsam.Pose2) -> npt.NDArray[np.float64]:
    whole = np.eye(4)
    whole[:2, :2], whole[:2, 3] = pose.rotation().matrix(), (pose.x(), pose.y())
    return whole


def _information(model: gtsam.noiseModel.Gaussian) -> npt.NDArray[np.float64]:
    """Return what a model of x, y and yaw says of x, y, z and the turns about them."""
    planar = model.information()
    whole = np.eye(6) / _LEVEL**2
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = planar
    turns = np.array([1.0, 1.0, 1.0, *[math.sqrt(_OF_TURN)] * 3])
    return whole * np.outer(turns, turns)


def _planar(whole: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    return whole[0, 3], whole[1, 3], math.atan2(whole[1, 0], whole[0, 0])
