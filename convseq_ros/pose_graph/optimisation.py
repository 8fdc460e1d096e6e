# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robust solution of a pose graph, by GTSAM: wrong loop closures are ignored."""

from collections.abc import Iterable
from typing import Any

from convseq_ros.core.rigid import Matrix
from convseq_ros.errors import ConvseqError, pip_install
from convseq_ros.pose_graph.edges import Edge, Poses
import numpy as np

_HELD = 1e-4  # standard deviation of the first pose, metres and radians


def optimise(edges: Iterable[Edge], start: Poses) -> dict[int, Matrix]:
    """Return the optimised poses, by odometry and links; wrong links are ignored."""
    gtsam = _gtsam()
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for index, pose in start.items():
        values.insert(index, gtsam.Pose3(pose))
    first = min(start)
    held = gtsam.noiseModel.Isotropic.Sigma(6, _HELD)
    graph.add(gtsam.PriorFactorPose3(first, gtsam.Pose3(start[first]), held))
    usable = [edge for edge in edges if edge.start in start and edge.end in start]
    for edge in sorted(usable, key=lambda edge: edge.is_link):
        turns_first = np.roll(edge.covariance, (3, 3), (0, 1))  # GTSAM's order
        noise = gtsam.noiseModel.Gaussian.Covariance(turns_first)
        moved = gtsam.Pose3(edge.moved)
        graph.add(gtsam.BetweenFactorPose3(edge.start, edge.end, moved, noise))
    result, _ = gnc_fit(graph, values, graph.size() - sum(edge.is_link for edge in usable))
    return {index: np.asarray(result.atPose3(index).matrix()) for index in start}


def gnc_fit(graph: Any, start: Any, trusted: int, share: float = 0.99) -> tuple[Any, list[bool]]:
    """
    Return the optimised values of a GTSAM graph, and which further factors they agree with.

    The first `trusted` factors are trusted. A further one counts if its error is below the
    `share` quantile of a right factor's error, by graduated non-convexity (Yang, RA-L 2020).
    """
    gtsam = _gtsam()
    # The least squares start of the method; it is the result if all factors are trusted.
    start = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    if graph.size() == trusted:
        return start, []
    settings = gtsam.GncLMParams()
    settings.setLossType(gtsam.GncLossType.TLS)
    settings.setKnownInliers([*range(trusted)])
    optimizer = gtsam.GncLMOptimizer(graph, start, settings)
    optimizer.setInlierCostThresholdsAtProbability(share)
    result = optimizer.optimize()
    return result, [bool(weight > 0.5) for weight in optimizer.getWeights()[trusted:]]


def _gtsam() -> Any:
    try:
        import gtsam
    except ImportError:
        raise ConvseqError(
            f'gtsam is not installed, which brings sessions into one frame: {pip_install("gtsam")}'
        ) from None
    return gtsam
