# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The edges of a pose graph: steps of odometry, and links as loop closures."""

from collections.abc import Mapping
from dataclasses import dataclass

from convseq_ros.core.rigid import Matrix
from convseq_ros.core.types import constants
import numpy as np

Poses = Mapping[int, Matrix]  # (4, 4), by the index of a place


@constants
class EDGE:
    """Standard deviations of links; chosen by experience, not tuned."""

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


def link_edge(start: int, end: int, moved: Matrix, covariance: Matrix) -> Edge:
    """Return a loop closure; the covariance (6, 6) is in the axes of the start."""
    to_end = np.kron(np.eye(2), moved[:3, :3].T)
    floor = np.diag([EDGE.finest_m**2] * 3 + [EDGE.finest_rad**2] * 3)
    return Edge(start, end, moved, to_end @ covariance @ to_end.T + floor, True)
