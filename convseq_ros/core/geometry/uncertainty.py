# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From the motion between two lenses to the pose between two bases, and its covariance."""

from dataclasses import dataclass, replace

from convseq_ros.core.geometry.alignment import Alignment
from convseq_ros.core.rigid import cross, inverse, Matrix, quaternion, vector
from convseq_ros.core.types import constants, RelativePose, UNKNOWN_M2, Vector
import numpy as np


@dataclass(frozen=True, slots=True)
class Spread:
    """The error model of an alignment."""

    # Factors on the alignment's sigmas, divided by a power of the share that agrees at first: if
    # few agree, all is worse. Most parallax is horizontal, and a field misses part of it; so yaw
    # and the translation across have larger errors than pitch, roll and the translation down.
    across: float
    down: float
    ahead: float
    share_power: float
    far: float  # share of the distance beyond the neighbours, if that is as long as the baseline
    position_m: float  # least sigma, however many regions or keypoints agree
    turn_rad: float  # the same for turns


@constants
class ERROR:
    """Fitted on drawn streets 41 to 48, evening, clouds and night (docs/GEOMETRY.md)."""

    # `far` was measured with all neighbours on one side, on drawn streets and on roads.
    cells: Spread = Spread(
        across=2.9, down=1.3, ahead=2.5, share_power=0.2, far=0.15, position_m=0.01, turn_rad=0.001
    )
    # Real roads include odometry errors; on drawn streets smaller values would do.
    keypoints: Spread = Spread(
        across=0.5,
        down=0.5,
        ahead=0.5,
        share_power=3.0,
        far=0.03,
        position_m=0.002,
        turn_rad=0.0005,
    )
    # A position is not reported if its sigma exceeds both limits, or if too few regions agree.
    unsure_m: float = 1.0
    unsure_share: float = 0.5  # of the distance
    # Least shares of regions that agree; most poses with errors over 1 m have smaller ones.
    least_share: float = 0.35  # with fewer, the pose does not explain the images
    position_share: float = 0.5  # for a position


def base_pose(
    found: Alignment, base_reference: Matrix, base_query: Matrix, spread: Spread = ERROR.cells
) -> RelativePose:
    """
    Return the pose of a query's base in a reference's base.

    `base_reference` is the reference's lens in the base frame of the result, `base_query` the
    query's lens in the query's base. The default spread is that of cells.
    """
    lens = inverse(found.moved)  # the query's, in the reference's
    base = inverse(base_query)
    between = base_reference @ lens @ base
    turn = base_reference[:3, :3] @ lens[:3, :3]  # from the query's lens
    # The alignment's errors are a turn and a translation in the query's lens, after the motion.
    arm = cross(base[:3, 3] - found.moved[:3, 3])
    slopes = np.zeros((6, 6))
    slopes[:3, :3] = turn @ arm
    slopes[:3, 3:] = slopes[3:, :3] = -turn
    across, down, ahead = spread.across, spread.down, spread.ahead
    scatter = np.array((down, across, down, across, down, ahead))
    slopes *= scatter / found.share**spread.share_power
    floor = np.diag([spread.position_m**2] * 3 + [spread.turn_rad**2] * 3)
    far = base_reference[:3, :3] @ _far(found, lens[:3, 3]) * spread.far
    floor[:3, :3] += np.outer(far, far)
    covariance = slopes @ found.covariance @ slopes.T + floor
    position = between[:3, 3]
    values = quaternion(between[:3, :3]), vector(position), _unit(position), covariance
    # Few inliers mean that the alignment is wrong.
    explains = found.share >= ERROR.least_share
    pose = RelativePose(*values, found.inliers, explains)
    most_m = max(ERROR.unsure_m, ERROR.unsure_share * float(np.linalg.norm(lens[:3, 3])))
    is_unsure = (pose.position_sigma_m or 0.0) > most_m or found.share < ERROR.position_share
    if is_unsure or not explains:
        return replace(pose, position_m=None, covariance=_of_turns(covariance[3:, 3:]))
    return pose


def _far(found: Alignment, translation: Matrix) -> Matrix:
    """
    Return the part of a translation (3,) beyond the neighbours that gave depths, in their scale.

    Up to the neighbours, errors of their fields and of the query's cancel. Beyond, the estimated
    translation is too short, in proportion to the squared distance over the baseline.
    """
    length_m = float(np.linalg.norm(translation))
    if length_m == 0.0:
        return translation
    ahead = translation / length_m
    beyond_m = length_m - float((found.neighbours @ ahead).clip(0.0, length_m).max(initial=0.0))
    return np.asarray(ahead * beyond_m**2 / found.baseline_m)


def _of_turns(turns: Matrix) -> Matrix:
    """Return a covariance (6, 6) from that of turns (3, 3), with an unknown position."""
    covariance = np.eye(6) * UNKNOWN_M2
    covariance[3:, 3:] = turns
    return covariance


def _unit(translation: Matrix) -> Vector | None:
    length = float(np.linalg.norm(translation))
    return vector(translation / length) if length > 0 else None
