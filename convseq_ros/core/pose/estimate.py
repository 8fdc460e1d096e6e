# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose of the camera in the map, and its covariance, after a place was recognised."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, takewhile
import math

from convseq_ros.core.map.place import Place
from convseq_ros.core.pose.map_motion import NEIGHBOURS
from convseq_ros.core.rigid import composed_covariance, Matrix, matrix, moved_covariance, pose_of
from convseq_ros.core.types import constants, Match, Pose, PoseEstimate, RelativePose, Row
import numpy as np


@constants
class ESTIMATE:
    """Engineering, not studied."""

    same_spot_m: float = 1e-3  # places closer than this were taken by a robot that stood still
    as_good: float = 0.9  # share of the place's pair score from which a neighbour is as good
    unknown_turn_rad: float = 0.3  # sigma of the heading where the yaw is not known


def estimate_pose(
    places: Sequence[Place],
    index: int,
    *,
    yaw_rad: float | None = None,
    row: Row | None = None,
    relative: RelativePose | None = None,
) -> PoseEstimate | None:
    """
    Return the pose of a camera that sees a place of the map; None if the place has no pose.

    If `relative` has a position in metres, the result is the place's pose moved by it, with its
    errors. Otherwise it is the place's pose, turned to the left by `yaw_rad`. `row` holds the pair
    scores (r,) of the newest frame with the first r places; NaN where there is none.

    Without a measured position, two independent errors add up. (1) The distance between places: a
    camera that sees this place is anywhere up to half-way to the next. This error is uniform along
    that direction; its variance is a twelfth of the squared distance to the nearer neighbour.
    (2) The doubt between neighbours: the mean square of the offsets to all adjacent places whose
    pair score is at least 90 % of this place's. The heading has the second error, and 0.3 rad more
    if the yaw is not known. The error of the map's poses is in neither (`with_map_errors`).
    """
    pose = places[index].pose
    if pose is None:
        return None
    covariance = np.zeros((6, 6))
    if relative is not None and relative.pose:
        there, motion = matrix(pose), matrix(relative.pose)
        covariance = composed_covariance(there, covariance, motion, relative.covariance)
        return PoseEstimate(pose_of(there @ motion), covariance)
    step = _to_nearer_neighbour(places, index, pose)
    covariance[:3, :3] += np.outer(step, step) / 12
    similar = [pose, *(other for at in _as_good(places, index, row) if (other := places[at].pose))]
    offsets = np.array([np.subtract(other.position, pose.position) for other in similar])
    turns = np.array([math.remainder(other.yaw_rad - pose.yaw_rad, math.tau) for other in similar])
    covariance[:3, :3] += offsets.T @ offsets / len(offsets)
    covariance[5, 5] += (turns @ turns) / len(turns)
    if yaw_rad is None:
        covariance[5, 5] += ESTIMATE.unknown_turn_rad**2
    return PoseEstimate(turned(pose, yaw_rad or 0.0), covariance)


def with_map_errors(
    estimate: PoseEstimate, place: Pose, position_sigma_m: float, heading_sigma_rad: float
) -> PoseEstimate:
    """
    Return an estimate with the error of the map's pose of the place that it was measured from.

    The sigmas are standard deviations of that pose along and about every axis. The error of the
    heading moves an estimate that is away from the place.
    """
    of_place = np.diag([position_sigma_m**2] * 3 + [heading_sigma_rad**2] * 3)
    moved = np.subtract(estimate.pose.position, place.position)
    return replace(estimate, covariance=estimate.covariance + moved_covariance(of_place, moved))


def with_pose(match: Match, row: Row | None, places: Sequence[Place]) -> Match:
    """Return a match with the pose of the camera, if it is accepted; `row` is its pair scores."""
    if match.accepted is None:
        return match
    yaw_rad, relative = match.relative_yaw_rad, match.relative_pose
    index = match.accepted.reference_index
    pose = estimate_pose(places, index, yaw_rad=yaw_rad, row=row, relative=relative)
    return replace(match, pose=pose)


def turned(pose: Pose, yaw_rad: float) -> Pose:
    """Return a pose turned on the spot, counter-clockwise about the z axis of the map."""
    if not yaw_rad:
        return pose
    sine, cosine = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
    x, y, z, w = pose.orientation
    turned_x, turned_y = cosine * x - sine * y, cosine * y + sine * x
    turned_z, turned_w = cosine * z + sine * w, cosine * w - sine * z
    return Pose(pose.position, (turned_x, turned_y, turned_z, turned_w))


def _to_nearer_neighbour(places: Sequence[Place], index: int, here: Pose) -> Matrix:
    """Return the offset (3,), in metres, to the nearer of the next places on either side."""
    nearest: list[Matrix] = []
    for side in _sides(places, index, len(places)):
        poses = (other for at in side if (other := places[at].pose))
        offsets = (np.subtract(other.position, here.position) for other in poses)
        nearest += islice((one for one in offsets if math.hypot(*one) > ESTIMATE.same_spot_m), 1)
    return min(nearest, key=lambda one: float(one @ one), default=np.zeros(3))


def _sides(places: Sequence[Place], index: int, count: int) -> Iterator[Iterator[int]]:
    """Yield up to 10 places of the session before a place, then after it, nearest first."""
    before = range(index - 1, max(index - NEIGHBOURS.reach, 0) - 1, -1)
    session = places[index].session
    for side in (before, range(index + 1, min(index + NEIGHBOURS.reach + 1, count))):
        yield takewhile(lambda at: places[at].session == session, side)


def _as_good(places: Sequence[Place], index: int, row: Row | None) -> Iterator[int]:
    """Yield the adjacent places that score nearly as well, up to the first that does not."""
    if row is not None and index < len(row) and row[index] > 0:
        least = ESTIMATE.as_good * float(row[index])
        for side in _sides(places, index, len(row)):
            yield from takewhile(lambda at: float(row[at]) >= least, side)
