# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses in the map: between its places, of the camera at a match, and places near a pose."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, takewhile
import math

from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import (
    composed_covariance,
    inverse,
    Matrix,
    matrix,
    moved_covariance,
    pose_of,
)
from convseq_ros.core.types import (
    constants,
    Doubles,
    Indices,
    Match,
    Pose,
    PoseEstimate,
    RelativePose,
    Row,
)
import numpy as np


@constants
class NEIGHBOURS:
    """The choice of neighbours; tuned on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    reach: int = 10  # places to either side that are searched
    count: int = 2  # neighbours that give depth; one on either side is better than two on one
    apart_m: float = 1.8  # least distance to the first neighbour, and from each to the next
    most_turned: float = 0.8  # least cosine of the turn to a neighbour
    nearer_m: float = 0.3  # the pose is measured again from a place that is nearer by this


class MapMotion:
    """Motions between places of a map, which may grow."""

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map

    def moved(self, index: int, other: int) -> Matrix | None:
        """Return the motion (4, 4) of the base from a place to another of its drive, if known."""
        if self._distance_m(index, other) is None:
            return None
        first, second = self._map.places[index].pose, self._map.places[other].pose
        assert first and second
        return inverse(matrix(second)) @ matrix(first)

    def _distance_m(self, index: int, other: int) -> float | None:
        """Return the distance between two places of one drive, if known."""
        places = self._map.places
        if not (0 <= index < len(places) and 0 <= other < len(places)):
            return None
        first, second = places.position(index), places.position(other)
        if first is None or second is None or places.session(index) != places.session(other):
            return None
        return math.dist(first, second)

    def neighbours(self, index: int, times: int = 1) -> list[tuple[int, Matrix]]:
        """
        Return neighbours on both sides of a place, or on one side, and the motions to them.

        Returns `times` more neighbours, at 1/`times` of the spacing.
        """
        sides = [self._on_side(index, side, times) for side in (-1, 1)]
        if all(sides):
            sides = [neighbours[: times * NEIGHBOURS.count // 2] for neighbours in sides]
        return [neighbour for neighbours in sides for neighbour in neighbours]

    def _on_side(self, index: int, side: int, times: int) -> list[tuple[int, Matrix]]:
        """Return neighbours before a place (side -1) or after it (1), up to 2 `times`."""
        neighbours: list[tuple[int, Matrix]] = []
        last_m = 0.0
        for step in range(1, NEIGHBOURS.reach + 1):
            distance_m = self._distance_m(index, other := index + side * step)
            if distance_m is None or len(neighbours) == times * NEIGHBOURS.count:
                break
            if distance_m < last_m + NEIGHBOURS.apart_m / times:
                continue
            moved = self.moved(index, other)
            if moved is not None and moved[0, 0] >= NEIGHBOURS.most_turned:
                neighbours.append((other, moved))
                last_m = distance_m
        return neighbours

    def nearest(self, index: int, pose: RelativePose) -> int:
        """Return the place nearest to a pose that is relative to place `index` of its drive."""
        places, reference = self._map.places, self._map.places[index]
        if pose.position_m is None or reference.pose is None:
            return index
        here = (matrix(reference.pose) @ (*pose.position_m, 1.0))[:3]
        best, least_m = index, math.hypot(*pose.position_m) - NEIGHBOURS.nearer_m
        near = self._map.bounds.around(index, NEIGHBOURS.reach)
        for other in range(near.start, min(near.stop, len(places))):
            position = places.position(other)
            if position is not None and (distance_m := math.dist(position, here)) < least_m:
                best, least_m = other, distance_m
        return best


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


@constants
class NEARBY:
    """How near a place is; engineering, not studied."""

    least_m: float = 0.5  # standard deviation that is added, or the distance between places
    sigmas: float = 3.0  # beyond which a place is not near


def places_near(
    reference_map: ReferenceMap, estimate: PoseEstimate, usable: int
) -> tuple[Indices, Doubles]:
    """
    Return places (n,), ascending, near a pose of the base, and their weights (n,), of sum 1.

    Of the first `usable` places those with poses count, seen from above: a pose that a person sets
    on a plan has no height.
    """
    positions = reference_map.places.columns['pose'][:usable, :2]
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    spacing_m = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
    floor = np.eye(2) * max(NEARBY.least_m, spacing_m) ** 2
    off = positions - estimate.pose.position[:2]
    squares = (off @ np.linalg.inv(estimate.covariance[:2, :2] + floor) * off).sum(axis=1)
    places = np.flatnonzero(squares <= NEARBY.sigmas**2)  # not NaN
    weights = np.exp(-0.5 * squares[places])
    return places, weights / weights.sum()
