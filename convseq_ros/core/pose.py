# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the camera is, and how surely, when a place of the map was recognised."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math

from convseq_ros.core.map.reference_map import Place
from convseq_ros.core.sequence.diagonals import Row
from convseq_ros.core.types import Pose
import numpy as np
import numpy.typing as npt

_LOOK = 10
_SAME_SPOT_M = 1e-3
_AS_GOOD = 0.9
_UNKNOWN_TURN_RAD = 0.3

Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """
    A pose and its uncertainty.

    Parameters
    ----------
    pose : Pose
        In the frame of the map.
    covariance : ndarray of float64, shape (6, 6)
        Of x, y, z in metres and of turns about the axes x, y, z of the map in radians.

    """

    pose: Pose
    covariance: Matrix


def estimate_pose(
    places: Sequence[Place],
    index: int,
    *,
    yaw_rad: float | None = None,
    row: Row | None = None,
    position_sigma_m: float = 0.0,
    heading_sigma_rad: float = 0.0,
) -> PoseEstimate | None:
    """
    Return where the camera is that sees a place of the map.

    Parameters
    ----------
    places : sequence of Place
        The map.
    index : int
        The place that was recognised.
    yaw_rad : float, optional
        By how much the camera is turned to the left of the reference's.
    row : ndarray of float32, shape (r,), optional
        Pair scores of the newest frame with the first r places; NaN where unknown.
    position_sigma_m, heading_sigma_rad : float
        Standard deviations of the map's own poses: along, and about, every axis. Neither can the
        result be more certain.

    Returns
    -------
    PoseEstimate or None
        None if the map does not say where the place is.

    Notes
    -----
    The pose is that of the reference, turned by the yaw. Three independent errors add up: that of
    the map's poses; the way between places, since a camera that sees this one is anywhere up to
    half-way to the next (a uniform error, its variance a twelfth of the squared distance to the
    nearer neighbour, along that direction); and doubt between neighbours, the mean square of the
    offsets to all places in a row around this one whose pair score is at least 0.9 of its own.
    The heading has the first and the third error, and 0.3 rad more where the yaw is not known.

    """
    pose = places[index].pose
    if pose is None:
        return None
    covariance = np.diag([position_sigma_m**2] * 3 + [heading_sigma_rad**2] * 3)
    step = _to_nearer_neighbour(places, index)
    covariance[:3, :3] += np.outer(step, step) / 12
    rivals = [other for at in _as_good(index, row) if (other := places[at].pose)]
    offsets = np.array([_offset(pose, other) for other in (pose, *rivals)])
    turns = np.array([_yaw_between(pose, other) for other in (pose, *rivals)])
    covariance[:3, :3] += offsets.T @ offsets / len(offsets)
    covariance[5, 5] += (turns @ turns) / len(turns)
    if yaw_rad is None:
        covariance[5, 5] += _UNKNOWN_TURN_RAD**2
    return PoseEstimate(turned(pose, yaw_rad or 0.0), covariance)


def turned(pose: Pose, yaw_rad: float) -> Pose:
    """Return a pose turned on the spot, counter-clockwise about the z axis of the map."""
    if not yaw_rad:
        return pose
    sine, cosine = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
    x, y, z, w = pose.orientation
    return Pose(
        pose.position,
        (
            cosine * x - sine * y,
            cosine * y + sine * x,
            cosine * z + sine * w,
            cosine * w - sine * z,
        ),
    )


def _to_nearer_neighbour(places: Sequence[Place], index: int) -> Matrix:
    """Return the way to the nearer of the next places, on either side, that lie elsewhere."""
    here = places[index].pose
    ways = [
        way
        for step in (-1, 1)
        if (way := _first_way(here, _walk(places, index, step))) is not None
    ]
    return min(ways, key=lambda way: float(way @ way), default=np.zeros(3))


def _first_way(here: Pose | None, others: Iterator[Pose]) -> Matrix | None:
    for other in others:
        if here and math.dist(here.position, other.position) > _SAME_SPOT_M:
            return _offset(here, other)
    return None


def _walk(places: Sequence[Place], index: int, step: int) -> Iterator[Pose]:
    last = index + step * (_LOOK + 1)
    for at in range(index + step, min(max(last, -1), len(places)), step):
        pose = places[at].pose
        if pose:
            yield pose


def _as_good(index: int, row: Row | None) -> Iterator[int]:
    """Yield the neighbours, without a break, that score nearly as well."""
    if row is None or index >= len(row) or not row[index] > 0:
        return
    least = _AS_GOOD * float(row[index])
    for step in (-1, 1):
        for at in range(index + step, index + step * (_LOOK + 1), step):
            if not 0 <= at < len(row) or not float(row[at]) >= least:
                break
            yield at


def _offset(pose: Pose, other: Pose) -> Matrix:
    return np.subtract(other.position, pose.position)


def _yaw_between(pose: Pose, other: Pose) -> float:
    difference = _yaw(other) - _yaw(pose)
    return math.atan2(math.sin(difference), math.cos(difference))


def _yaw(pose: Pose) -> float:
    x, y, z, w = pose.orientation
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
