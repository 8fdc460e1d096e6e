# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loop closures as a back end is told of them, and what became of them."""

from dataclasses import dataclass

from convseq_ros.core.rigid import Matrix
from convseq_ros.core.types import Pose, RelativePose, UNKNOWN_M2
from convseq_ros.pose_graph.edges import Edge
import numpy as np

UNKNOWN_RAD2 = 10.0  # variance of a turn that is not measured
_TURN_KNOWN_RAD2 = 3.0


@dataclass(frozen=True, eq=False, slots=True)
class Closure:
    """The pose of a robot at one time, measured from where it was at another."""

    query_ns: int
    reference_ns: int
    moved: Matrix  # (4, 4), pose of the query in the reference's frame
    covariance: Matrix  # (6, 6), in the reference's axes; UNKNOWN_M2 where there is no position
    session: str = ''  # of the reference; empty for the running drive

    @property
    def key(self) -> tuple[int, str, int]:
        """The pair of places; microseconds, as a float64 of seconds tells them."""
        return round(self.query_ns / 1000), self.session, round(self.reference_ns / 1000)

    @property
    def is_measured(self) -> bool:
        """Whether the position is known."""
        return bool(self.covariance[:3, :3].max() < UNKNOWN_M2 / 2)


@dataclass(slots=True)
class Known:
    """What became of a closure."""

    closure: Closure
    edge: Edge | None = None  # None while one of its places is not known
    kept: bool | None = None  # whether the solution agrees; None before it is solved
    error: float = 0.0  # in standard deviations
    apart_m: float = 0.0  # between the measured and the corrected pose, ...
    apart_rad: float = 0.0


def told(relative: RelativePose | None) -> tuple[Pose, Matrix]:
    """
    Return the pose of a query in its reference, and the covariance (6, 6), as others are told it.

    Without a measured position it is zero, with a variance of 1e6 m2; without a measured turn, of
    10 rad2.
    """
    covariance = np.diag([UNKNOWN_M2] * 3 + [UNKNOWN_RAD2] * 3)
    if relative is None:
        return Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), covariance
    if relative.position_m:
        return Pose(relative.position_m, relative.orientation), relative.covariance
    covariance[3:, 3:] = relative.covariance[3:, 3:]
    return Pose((0.0, 0.0, 0.0), relative.orientation), covariance


def usable(covariance: Matrix, sigma_rad: float) -> Matrix:
    """Return a covariance (6, 6) that was told; `sigma_rad` is of a turn that is not measured."""
    if covariance[5, 5] <= _TURN_KNOWN_RAD2:
        return covariance
    covariance = covariance + np.diag([UNKNOWN_M2] * 3 + [0.0] * 3)
    covariance[3:, 3:] = np.eye(3) * sigma_rad**2
    return covariance
