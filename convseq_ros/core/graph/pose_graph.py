# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose graph of a map: odometry and links as edges; written as a g2o file, or optimised."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from convseq_ros.core.graph.links import Link
from convseq_ros.core.rigid import angle, inverse, Matrix, matrix, pose_of
from convseq_ros.core.types import constants
from convseq_ros.errors import ConvseqError, pip_install
import numpy as np

Poses = Mapping[int, Matrix]  # (4, 4), by the index of a place


@constants
class GRAPH:
    """Standard deviations and limits; chosen by experience, not tuned."""

    least_m: float = 0.02  # standard deviation of an odometry step: constant part, ...
    of_way: float = 0.05  # ... and share of the distance
    least_rad: float = 0.01
    of_turn: float = 0.05  # share of the turn
    finest_m: float = 0.1  # added to each link, as errors of neighbouring links are correlated
    finest_rad: float = 0.02
    held: float = 1e-4  # standard deviation of the first pose, metres and radians
    near_m: float = 3.0  # distance within which two links agree on where a session lies
    tried: int = 60  # links that are tried to align a session


@dataclass(frozen=True, eq=False, slots=True)
class Edge:
    """The pose of one place relative to another, with its covariance."""

    start: int
    end: int
    moved: Matrix  # (4, 4), pose of the end in the start's frame
    covariance: Matrix  # (6, 6), of x, y, z in metres and turns about them, in the end's axes
    is_link: bool


def edges_of(poses: Poses, session: Sequence[int], links: Iterable[Link]) -> Iterator[Edge]:
    """Yield odometry steps between successive poses of a session, then links with a position."""
    for start, end in pairwise(poses):
        if session[start] == session[end]:
            moved = inverse(poses[start]) @ poses[end]
            way_m, turn_rad = float(np.linalg.norm(moved[:3, 3])), angle(moved[:3, :3])
            sigma_m = GRAPH.least_m + GRAPH.of_way * way_m
            sigma_rad = GRAPH.least_rad + GRAPH.of_turn * turn_rad
            sigmas = np.array([sigma_m] * 3 + [sigma_rad] * 3)
            yield Edge(start, end, moved, np.diag(sigmas**2), False)
    floor = np.diag([GRAPH.finest_m**2] * 3 + [GRAPH.finest_rad**2] * 3)
    for link in links:
        relative = link.relative
        if relative and relative.pose and link.place in poses and link.other in poses:
            moved = matrix(relative.pose)
            to_end = np.kron(np.eye(2), moved[:3, :3].T)
            covariance = to_end @ relative.covariance @ to_end.T + floor
            yield Edge(link.other, link.place, moved, covariance, True)


def g2o(poses: Poses, edges: Iterable[Edge]) -> Iterator[str]:
    """Yield the lines of a g2o file: a vertex for each place, by index, then the edges."""
    for index, pose in poses.items():
        yield f'VERTEX_SE3:QUAT {index} {_numbers(pose)}'
    for edge in edges:
        information = np.linalg.inv(edge.covariance)
        upper = ' '.join(f'{value:.9g}' for value in information[np.triu_indices(6)])
        yield f'EDGE_SE3:QUAT {edge.start} {edge.end} {_numbers(edge.moved)} {upper}'


def _numbers(moved: Matrix) -> str:
    pose = pose_of(moved)
    return ' '.join(f'{value:.9g}' for value in (*pose.position, *pose.orientation))


def align_sessions(
    poses: Poses, session: Sequence[int], edges: Iterable[Edge]
) -> dict[int, Matrix]:
    """Return the poses of linked sessions in the frame of the first; links vote on each motion."""
    links = [edge for edge in edges if edge.is_link]
    if not links:
        return {}
    moves = {min(session[end] for edge in links for end in (edge.start, edge.end)): np.eye(4)}
    while True:
        # By session that has no motion yet: (goal, pose) of its places with a link to one moved.
        pairs = dict[int, list[tuple[Matrix, Matrix]]]()
        for edge in links:
            forth = edge.start, edge.end, edge.moved
            for fixed, new, moved in (forth, (edge.end, edge.start, inverse(edge.moved))):
                if session[fixed] in moves and session[new] not in moves:
                    goal = moves[session[fixed]] @ poses[fixed] @ moved
                    pairs.setdefault(session[new], []).append((goal, poses[new]))
        if not pairs:
            break
        best = max(pairs, key=lambda number: len(pairs[number]))
        moves[best] = _agreed(pairs[best])
    return {at: moves[session[at]] @ pose for at, pose in poses.items() if session[at] in moves}


def _agreed(pairs: Sequence[tuple[Matrix, Matrix]]) -> Matrix:
    """Return the motion that brings most poses to their goals; `pairs` are (goal, pose)."""
    goals = np.array([goal[:3, 3] for goal, _ in pairs])
    positions = np.array([pose[:3, 3] for _, pose in pairs])
    best, most = np.eye(4), -1
    for goal, pose in pairs[:: max(1, len(pairs) // GRAPH.tried)]:
        move = goal @ inverse(pose)
        errors_m = np.linalg.norm(positions @ move[:3, :3].T + move[:3, 3] - goals, axis=1)
        if (count := int((errors_m <= GRAPH.near_m).sum())) > most:
            best, most = move, count
    return best


def optimise(edges: Iterable[Edge], start: Poses) -> dict[int, Matrix]:
    """Return the optimised poses, by odometry and links; wrong links are ignored."""
    gtsam = _gtsam()
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for index, pose in start.items():
        values.insert(index, gtsam.Pose3(pose))
    first = min(start)
    held = gtsam.noiseModel.Isotropic.Sigma(6, GRAPH.held)
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
