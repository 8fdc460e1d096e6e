# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph of a map's poses and links: as a g2o file, and solved."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from convseq_ros.core.constants import constants
from convseq_ros.core.graph.links import Link
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import angle, inverse, Matrix, matrix, pose_of
from convseq_ros.core.types import Pose
from convseq_ros.errors import ConvseqError, pip_install
import numpy as np

Poses = Mapping[int, Matrix]  # (4, 4), by the index of a place


@constants
class GRAPH:
    """Engineering, not studied."""

    least_m: float = 0.02  # standard deviation of a step of odometry, ...
    of_way: float = 0.05  # ... of its way, ...
    least_rad: float = 0.01
    of_turn: float = 0.05  # ... and of its turn
    finest_m: float = 0.1  # that a link has at least: neighbours see the same map alike
    finest_rad: float = 0.02
    held: float = 1e-4  # standard deviation of the first pose, metres and radians
    near_m: float = 3.0  # within which two links agree on where a session lies
    tried: int = 60  # links of two sessions by which that is guessed


@dataclass(frozen=True, eq=False, slots=True)
class Edge:
    """Where one place lies in another's frame, and the covariance of that."""

    start: int
    end: int
    moved: Matrix  # (4, 4)
    covariance: Matrix  # (6, 6), of x, y, z in metres and turns about them, in the start's frame
    is_link: bool


def poses_of(whole: ReferenceMap) -> dict[int, Matrix]:
    """Return the poses of a map's places that have one."""
    return {at: matrix(one.pose) for at, one in enumerate(whole.places) if one.pose}


def edges_of(whole: ReferenceMap, links: Sequence[Link]) -> Iterator[Edge]:
    """Yield the steps of odometry in each session, then the links that are measured in metres."""
    known = poses_of(whole)
    for one, two in pairwise(known):
        if whole.places[one].session == whole.places[two].session:
            moved = inverse(known[one]) @ known[two]
            way_m, turn_rad = float(np.linalg.norm(moved[:3, 3])), angle(moved[:3, :3])
            sigma_m = GRAPH.least_m + GRAPH.of_way * way_m
            sigma_rad = GRAPH.least_rad + GRAPH.of_turn * turn_rad
            sigmas = np.array([sigma_m] * 3 + [sigma_rad] * 3)
            yield Edge(one, two, moved, np.diag(sigmas**2), False)
    floor = np.diag([GRAPH.finest_m**2] * 3 + [GRAPH.finest_rad**2] * 3)
    for link in links:
        relative = link.relative
        if relative and relative.pose and link.place in known and link.other in known:
            covariance = relative.covariance + floor
            yield Edge(link.other, link.place, matrix(relative.pose), covariance, True)


def g2o(whole: ReferenceMap, edges: Sequence[Edge]) -> Iterator[str]:
    """Yield the lines of a g2o file: a vertex for each place by its index, and the edges."""
    for index, place in enumerate(whole.places):
        if place.pose:
            yield f'VERTEX_SE3:QUAT {index} {_numbers(place.pose)}'
    for edge in edges:
        information = np.linalg.inv(edge.covariance)
        upper = ' '.join(f'{value:.9g}' for value in information[np.triu_indices(6)])
        moved = _numbers(pose_of(edge.moved))
        yield f'EDGE_SE3:QUAT {edge.start} {edge.end} {moved} {upper}'


def _numbers(pose: Pose) -> str:
    return ' '.join(f'{value:.9g}' for value in (*pose.position, *pose.orientation))


def brought_together(whole: ReferenceMap, edges: Sequence[Edge]) -> dict[int, Matrix]:
    """
    Return the poses of the sessions that links connect with the first linked one, in its frame.

    Each session is moved as a whole, by the link that most other links agree with.
    """
    known, session = poses_of(whole), [place.session for place in whole.places]
    links = [edge for edge in edges if edge.is_link]
    if not links:
        return {}
    moves = {min(session[end] for edge in links for end in (edge.start, edge.end)): np.eye(4)}
    while True:
        found = [
            edge if session[edge.start] in moves else _turned_round(edge)
            for edge in links
            if (session[edge.start] in moves) != (session[edge.end] in moves)
        ]
        if not found:
            break
        new = session[found[0].end]
        own = [edge for edge in found if session[edge.end] == new]
        asked = [
            (moves[session[edge.start]] @ known[edge.start] @ edge.moved, known[edge.end])
            for edge in own
        ]
        moves[new] = _agreed(asked)
    return {at: moves[session[at]] @ pose for at, pose in known.items() if session[at] in moves}


def _turned_round(edge: Edge) -> Edge:
    return Edge(edge.end, edge.start, inverse(edge.moved), edge.covariance, True)


def _agreed(asked: Sequence[tuple[Matrix, Matrix]]) -> Matrix:
    """Return the motion that brings most poses, the second ones, to where they should be."""
    goals = np.array([goal[:3, 3] for goal, _ in asked])
    here = np.array([own[:3, 3] for _, own in asked])
    best, most = np.eye(4), -1
    for goal, own in asked[:: max(1, len(asked) // GRAPH.tried)]:
        move = goal @ inverse(own)
        off_m = np.linalg.norm(here @ move[:3, :3].T + move[:3, 3] - goals, axis=1)
        if (count := int((off_m <= GRAPH.near_m).sum())) > most:
            best, most = move, count
    return best


def solved(edges: Sequence[Edge], start: Poses) -> dict[int, Matrix]:
    """Return poses that agree best with odometry and links, of which wrong ones count little."""
    gtsam = _gtsam()
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for index, pose in start.items():
        values.insert(index, gtsam.Pose3(pose))
    first = min(start)
    held = gtsam.noiseModel.Isotropic.Sigma(6, GRAPH.held)
    graph.add(gtsam.PriorFactorPose3(first, gtsam.Pose3(start[first]), held))
    for edge in edges:
        if edge.start in start and edge.end in start:
            noise = gtsam.noiseModel.Gaussian.Covariance(_of_gtsam(edge))
            if edge.is_link:
                estimator = gtsam.noiseModel.mEstimator.Cauchy.Create(1.0)
                noise = gtsam.noiseModel.Robust.Create(estimator, noise)
            moved = gtsam.Pose3(edge.moved)
            graph.add(gtsam.BetweenFactorPose3(edge.start, edge.end, moved, noise))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    return {index: np.asarray(found.atPose3(index).matrix()) for index in start}


def _of_gtsam(edge: Edge) -> Matrix:
    """Return a covariance in the end's axes, turns first, as GTSAM has it."""
    turn = np.zeros((6, 6))
    turn[:3, 3:] = turn[3:, :3] = edge.moved[:3, :3].T
    return turn @ edge.covariance @ turn.T


def _gtsam() -> Any:
    try:
        import gtsam
    except ImportError:
        raise ConvseqError(
            f'gtsam is not installed, which brings sessions into one frame: {pip_install("gtsam")}'
        ) from None
    return gtsam
