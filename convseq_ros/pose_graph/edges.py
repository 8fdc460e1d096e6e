# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The edges of a map's pose graph: steps of odometry, and links as loop closures."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from convseq_ros.core.graph.links import Link
from convseq_ros.core.rigid import angle, inverse, Matrix, matrix
from convseq_ros.core.types import constants
import numpy as np

Poses = Mapping[int, Matrix]  # (4, 4), by the index of a place


@constants
class EDGE:
    """Standard deviations of edges; chosen by experience, not tuned."""

    least_m: float = 0.02  # standard deviation of an odometry step: constant part, ...
    of_distance: float = 0.05  # ... and share of the distance
    least_rad: float = 0.01
    of_turn: float = 0.05  # share of the turn
    finest_m: float = 0.1  # added to each link, as errors of neighbouring links are correlated
    finest_rad: float = 0.02


@dataclass(frozen=True, eq=False, slots=True)
class Edge:
    """The pose of one place relative to another, with its covariance."""

    start: int
    end: int
    moved: Matrix  # (4, 4), pose of the end in the start's frame
    covariance: Matrix  # (6, 6), of x, y, z in metres and turns about them, in the end's axes
    is_link: bool

    @property
    def ends(self) -> tuple[int, int]:
        """Both places."""
        return self.start, self.end


def edges_of(poses: Poses, session: Sequence[int], links: Iterable[Link]) -> Iterator[Edge]:
    """Yield odometry steps between successive poses of a session, then links with a position."""
    for start, end in pairwise(poses):
        if session[start] == session[end]:
            moved = inverse(poses[start]) @ poses[end]
            distance_m, turn_rad = float(np.linalg.norm(moved[:3, 3])), angle(moved[:3, :3])
            sigma_m = EDGE.least_m + EDGE.of_distance * distance_m
            sigma_rad = EDGE.least_rad + EDGE.of_turn * turn_rad
            sigmas = np.array([sigma_m] * 3 + [sigma_rad] * 3)
            yield Edge(start, end, moved, np.diag(sigmas**2), False)
    for link in links:
        relative = link.relative
        if relative and relative.pose and link.place in poses and link.other in poses:
            yield link_edge(link.other, link.place, matrix(relative.pose), relative.covariance)


def link_edge(start: int, end: int, moved: Matrix, covariance: Matrix) -> Edge:
    """Return a loop closure; the covariance (6, 6) is in the axes of the start."""
    to_end = np.kron(np.eye(2), moved[:3, :3].T)
    floor = np.diag([EDGE.finest_m**2] * 3 + [EDGE.finest_rad**2] * 3)
    return Edge(start, end, moved, to_end @ covariance @ to_end.T + floor, True)
