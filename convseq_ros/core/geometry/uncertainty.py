# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From the motion between two lenses to the pose between two bases, and how sure it is."""

from dataclasses import dataclass, replace

from convseq_ros.core.geometry.alignment import Alignment, TwoView
from convseq_ros.core.rigid import cross, inverse, Matrix, quaternion, vector
from convseq_ros.core.types import constants, RelativePose, UNKNOWN_M2, Vector
import numpy as np


@dataclass(frozen=True, slots=True)
class Spread:
    """How far off an alignment is."""

    # Times the alignment's deviations, over a power of the share that agreed at first: where few
    # agree all is bad. Parallax lies across the image, and so do the errors of a field that misses
    # some of it: yaw and the way across are off by more than pitch, roll and the way down.
    across: float
    down: float
    ahead: float
    share_power: float
    far: float  # of the way beyond the neighbours, along it, if that is as long as the baseline
    position_m: float  # what no number of regions or keypoints mends
    turn_rad: float


@constants
class ERROR:
    """Fitted on drawn streets 41 to 48, evening, clouds and night (docs/GEOMETRY.md)."""

    # `far` is seen where all neighbours are on one side: on such streets, and on roads.
    cells: Spread = Spread(
        across=2.9, down=1.3, ahead=2.5, share_power=0.2, far=0.15, position_m=0.01, turn_rad=0.001
    )
    # The same, where regions were followed.
    followed: Spread = replace(cells, across=2.5, down=2.1, ahead=2.3, share_power=0.3)
    # A road's odometry errs, a drawn street's does not: less would do for streets.
    keypoints: Spread = Spread(
        across=0.5,
        down=0.5,
        ahead=0.5,
        share_power=3.0,
        far=0.03,
        position_m=0.002,
        turn_rad=0.0005,
    )
    # A position that is less sure than this, or than half of the way, or with which fewer agree,
    # is not told.
    unsure_m: float = 1.0
    unsure_share: float = 0.5
    # Most that are off by more than a metre have less.
    least_share: float = 0.35  # before regions are followed
    least_last_share: float = 0.5  # at last, and of two views
    two_view_rad: float = 0.1  # where no depth is known, from a look at road_1 and road_2


def base_pose(
    found: Alignment, base_reference: Matrix, base_query: Matrix, spread: Spread | None = None
) -> RelativePose:
    """
    Return the pose of a query's base in a reference's base.

    `base_reference` is the reference's lens in the base that is asked for, `base_query` the
    query's lens in its own base. The spread is that of cells if none is given.
    """
    by_cells = ERROR.cells if found.first_share is None else ERROR.followed
    spread = spread or by_cells
    lens = inverse(found.moved)  # the query's, in the reference's
    base = inverse(base_query)
    whole = base_reference @ lens @ base
    turn = base_reference[:3, :3] @ lens[:3, :3]  # from the query's lens
    # The alignment's errors are a turn and a way in the query's lens, after the motion.
    arm = cross(base[:3, 3] - found.moved[:3, 3])
    slopes = np.zeros((6, 6))
    slopes[:3, :3] = turn @ arm
    slopes[:3, 3:] = slopes[3:, :3] = -turn
    first_share = found.share if found.first_share is None else found.first_share
    across, down, ahead = spread.across, spread.down, spread.ahead
    scatter = np.array((down, across, down, across, down, ahead))
    slopes *= scatter / first_share**spread.share_power
    floor = np.diag([spread.position_m**2] * 3 + [spread.turn_rad**2] * 3)
    far = base_reference[:3, :3] @ _far(found, lens[:3, 3]) * spread.far
    floor[:3, :3] += np.outer(far, far)
    covariance = slopes @ found.covariance @ slopes.T + floor
    position = whole[:3, 3]
    known = quaternion(whole[:3, :3]), vector(position), _unit(position), covariance
    # How much the first alignment explains tells whether it is right at all.
    explains = first_share >= ERROR.least_share
    pose = RelativePose(*known, found.inliers, explains)
    most_m = max(ERROR.unsure_m, ERROR.unsure_share * float(np.linalg.norm(lens[:3, 3])))
    is_unsure = (pose.position_sigma_m or 0.0) > most_m or found.share < ERROR.least_last_share
    if is_unsure or not explains:
        return replace(pose, position_m=None, covariance=_of_turns(covariance[3:, 3:]))
    return pose


def base_pose_of_two_views(
    found: TwoView, base_reference: Matrix, base_query: Matrix
) -> RelativePose:
    """Return what is known without depth; the direction is that of the lenses."""
    turn = base_reference[:3, :3] @ found.turned.T @ base_query[:3, :3].T
    direction = (
        None if found.direction is None else _unit(base_reference[:3, :3] @ found.direction)
    )
    covariance = _of_turns(np.eye(3) * ERROR.two_view_rad**2)
    explains = found.share >= ERROR.least_last_share
    return RelativePose(quaternion(turn), None, direction, covariance, found.inliers, explains)


def _far(found: Alignment, way: Matrix) -> Matrix:
    """
    Return along a way (3,) what lies beyond the images that gave the depths, times baselines.

    Up to them their errors and the query's cancel; further off, the way comes out too short.
    """
    length_m = float(np.linalg.norm(way))
    if length_m == 0.0:
        return way
    ahead = way / length_m
    beyond_m = length_m - float((found.neighbours @ ahead).clip(0.0, length_m).max(initial=0.0))
    return np.asarray(ahead * beyond_m**2 / found.baseline_m)


def _of_turns(turns: Matrix) -> Matrix:
    """Return a covariance (6, 6) of turns (3, 3) and of a position that is not known."""
    covariance = np.eye(6) * UNKNOWN_M2
    covariance[3:, 3:] = turns
    return covariance


def _unit(way: Matrix) -> Vector | None:
    length = float(np.linalg.norm(way))
    return vector(way / length) if length > 0 else None
