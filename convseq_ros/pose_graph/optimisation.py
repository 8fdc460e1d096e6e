# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robust solution of a pose graph, by GTSAM: wrong loop closures are ignored."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
import math
from typing import Any

from convseq_ros.core.rigid import Matrix
from convseq_ros.core.types import constants, Doubles, Flags
from convseq_ros.errors import load
from convseq_ros.pose_graph.edges import Edge, Poses
import numpy as np


@constants
class ROBUST:
    """Graduated non-convexity with truncated least squares (Yang, RA-L 2020)."""

    inlier: float = 16.81  # squared error of a right link, in variances: 99 % quantile, 6 numbers
    growth: float = 1.4  # of the control parameter in each step, as in the paper
    most_steps: int = 100
    settled: float = 1e-3  # relative change of the cost at the end
    asked: int = 200  # poses, at most, of which it is computed how well they are known
    held: float = 1e-4  # standard deviation of the first pose, metres and radians


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimised poses; for each usable link, in order, whether it counts and its error."""

    values: Any  # the poses, as GTSAM has them; those that are new or of use, if `whole` is given
    kept: tuple[bool, ...]
    errors: tuple[float, ...]  # in standard deviations
    whole: Callable[[], Any] | None = None  # returns all poses
    spread: Matrix | None = None  # (6, 6), covariance of the newest pose, in its axes

    def pose(self, index: int) -> Matrix:
        """Return one pose (4, 4)."""
        if self.values.exists(index):
            return np.asarray(self.values.atPose3(index).matrix())
        return self.poses[index]

    @cached_property
    def poses(self) -> dict[int, Matrix]:
        """All poses (4, 4) by index, ascending."""
        values = self.whole() if self.whole else self.values
        rows = need_gtsam().utilities.extractPose3(values)  # rotations by rows, positions
        poses = np.tile(np.eye(4), (len(rows), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = rows[:, :9].reshape(-1, 3, 3), rows[:, 9:]
        return dict(zip(values.keys(), poses, strict=True))


def optimise(
    edges: Iterable[Edge], start: Poses, held: Mapping[int, float] | None = None
) -> Solution:
    """
    Return the poses that fit odometry and links best; wrong links are ignored.

    `held` are standard deviations, in metres and radians, of poses that stay near their start; by
    default the first one does. Each step solves linear equations once, and is a call of C++: the
    method as GTSAM has it solves all of them to the end, which takes a hundred times as long.
    ConvseqError if GTSAM is not installed.
    """
    gtsam = need_gtsam()
    values = values_of(start)
    held = held or {min(start): ROBUST.held}
    trusted = priors(start, held)
    usable = [edge for edge in edges if edge.start in start and edge.end in start]
    for edge in usable:
        if not edge.is_link:
            trusted.add(factor_of(edge))
    links = [edge for edge in usable if edge.is_link]
    factors = [factor_of(edge) for edge in links]
    squares = squares_of(factors, values)
    is_near = _within_reach(links, [edge for edge in usable if not edge.is_link], start, held)
    mu, cost = _first_control(squares[is_near]), np.inf
    weights = _weights(squares, mu) * is_near
    for _ in range(ROBUST.most_steps):
        graph = gtsam.NonlinearFactorGraph(trusted)
        for edge, factor, weight in zip(links, factors, weights, strict=True):
            if weight == 1.0:
                graph.add(factor)
            elif weight > 0.0:
                graph.add(factor_of(edge, weight))
        solver = gtsam.LevenbergMarquardtOptimizer(graph, values)
        solver.iterate()
        values, before, cost = solver.values(), cost, solver.error()
        squares = squares_of(factors, values)
        is_decided = bool(np.isin(weights, (0.0, 1.0)).all())
        if is_decided and before - cost <= ROBUST.settled * (cost + 1):
            break
        mu *= ROBUST.growth
        weights = _weights(squares, mu) * is_near
    kept = tuple(bool(weight > 0.5) for weight in weights)
    return Solution(values, kept, tuple(np.sqrt(squares).tolist()))


def position_sigma_m(poses: Poses, edges: Iterable[Edge]) -> float:
    """
    Return how well the positions of solved poses are known, against the first one, in metres.

    It is the root mean square, over up to 200 poses, of the standard deviation along the worst
    axis, by edges that the solution keeps; they connect all poses.
    """
    gtsam = need_gtsam()
    graph = priors(poses, {min(poses): ROBUST.held})
    for edge in edges:
        if edge.start in poses and edge.end in poses:
            graph.add(factor_of(edge))
    isam = gtsam.ISAM2(isam_settings())
    isam.update(graph, values_of(poses))
    asked = [*poses][:: math.ceil(len(poses) / ROBUST.asked)]
    covariances = [isam.marginalCovariance(at)[3:, 3:] for at in asked]
    return math.sqrt(np.linalg.eigvalsh(covariances)[:, -1].mean())


def isam_settings() -> Any:
    """Return settings of iSAM2 for drives of any length: Cholesky's method fails on long ones."""
    settings = need_gtsam().ISAM2Params()
    settings.setFactorization('QR')
    return settings


def values_of(poses: Poses) -> Any:
    """Return poses as GTSAM has them."""
    gtsam = need_gtsam()
    values = gtsam.Values()
    for index, pose in poses.items():
        values.insert(index, gtsam.Pose3(pose))
    return values


def priors(poses: Poses, held: Mapping[int, float]) -> Any:
    """Return a graph that holds poses where they are, with standard deviations."""
    gtsam = need_gtsam()
    graph = gtsam.NonlinearFactorGraph()
    for index, sigma in held.items():
        noise = gtsam.noiseModel.Isotropic.Sigma(6, sigma)
        graph.add(gtsam.PriorFactorPose3(index, gtsam.Pose3(poses[index]), noise))
    return graph


def factor_of(edge: Edge, weight: float = 1.0) -> Any:
    """Return an edge as GTSAM has it."""
    gtsam = need_gtsam()
    turns_first = np.roll(edge.covariance, (3, 3), (0, 1))  # GTSAM's order
    noise = gtsam.noiseModel.Gaussian.Covariance(turns_first / weight)
    return gtsam.BetweenFactorPose3(edge.start, edge.end, gtsam.Pose3(edge.moved), noise)


def squares_of(factors: Iterable[Any], values: Any) -> Doubles:
    """Return the squared errors (n,) of factors, in variances."""
    return np.array([2 * factor.error(values) for factor in factors])


def _within_reach(
    links: Sequence[Edge], steps: Sequence[Edge], start: Poses, held: Mapping[int, float]
) -> Flags:
    """
    Return which links (n,) are no further off than all odometry together may err.

    One that is would keep graduated non-convexity from ever coming to a decision on the others.
    """
    extent_m2 = float((np.ptp([pose[:3, 3] for pose in start.values()], axis=0) ** 2).sum())
    loose = 3 * sum(sigma**2 for sigma in held.values())  # square metres, and square radians
    turns_rad2 = loose + sum(float(np.trace(step.covariance[3:, 3:])) for step in steps)
    known_m2 = loose + sum(float(np.trace(step.covariance[:3, :3])) for step in steps)
    known_m2 += min(turns_rad2, np.pi**2) * extent_m2
    gaps = [(start[one.start] @ one.moved - start[one.end])[:3, 3] for one in links]
    mays = [known_m2 + float(np.trace(one.covariance[:3, :3])) for one in links]
    off_m2 = np.square(np.reshape(gaps, (-1, 3))).sum(axis=1)
    return np.asarray(off_m2 <= ROBUST.inlier * np.array(mays))


def _first_control(squares: Doubles) -> float:
    """Return the control parameter with which the problem is still convex."""
    excess = 2 * float(squares.max(initial=0.0)) - ROBUST.inlier
    return ROBUST.inlier / excess if excess > 0 else np.inf


def _weights(squares: Doubles, mu: float) -> Doubles:
    """Return the weights (n,) of links in [0, 1]."""
    if not np.isfinite(mu):
        return np.array(squares <= ROBUST.inlier, np.float64)
    partly = np.sqrt(ROBUST.inlier * mu * (mu + 1) / np.maximum(squares, 1e-12)) - mu
    inner, outer = ROBUST.inlier * mu / (mu + 1), ROBUST.inlier * (mu + 1) / mu
    return np.where(squares <= inner, 1.0, np.where(squares >= outer, 0.0, partly))


def need_gtsam() -> Any:
    """Return the module; ConvseqError if it is not installed."""
    return load('gtsam', 'a pose graph')
