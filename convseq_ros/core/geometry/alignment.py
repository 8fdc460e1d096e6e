# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The pose of a lens that sees a reference's regions: robust least squares over all of them.

Depths are uncertain, most of all those of far regions. So they are estimated with the pose, each
with its information as a prior, and regions of unknown depth hardly affect the position. The fit
starts at a given pose with a wide sigma; for keypoints also at a pose from random samples. The
pose of the base, and how uncertain it is, follow.
"""

from contextlib import suppress
from dataclasses import dataclass, field, replace
import math

from convseq_ros.core.geometry.structure import DEPTH, Sight, Structure
from convseq_ros.core.rigid import cross, inverse, Matrix, quaternion, turned_by, vector
from convseq_ros.core.types import constants, Doubles, RelativePose, UNKNOWN_M2, Vector
import cv2
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class Precision:
    """The precision of regions or keypoints, in cells or in `KEYPOINT.unit_px`."""

    sigmas: tuple[float, ...]  # of the rounds of least squares
    agreeing: float  # largest error of an inlier
    fewest: int  # least number of inliers
    least_share: float = 0.0  # least share of inliers
    block: int = 1  # side of a square of regions whose errors are correlated, in regions


@constants
class ALIGNMENT:
    """Tuned on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    # For regions; unrelated images have fewer than 40 inliers.
    cells: Precision = Precision(sigmas=(1.0,) * 4 + (0.3,) * 7, agreeing=0.6, fewest=40, block=3)
    # Share of the step across that the field misses, per cell that it moves a region of median
    shrunk: float = 0.08  # depth; fitted on drawn streets
    # RANSAC for the start: least inverse depth of a point, in its sigmas, and the number of
    # samples; OpenCV draws the same ones each time.
    least_depth_sigmas: float = 3.0
    samples: int = 200
    # Probability of a sample without outliers, and the least number of points.
    probability: float = 0.999
    fewest_points: int = 8


@dataclass(frozen=True, eq=False, slots=True)
class Alignment:
    """A motion between two lenses and its covariance; equal to itself only."""

    moved: Matrix  # (4, 4), from the reference's lens to the other
    # (6, 6), of a turn and of a translation in the other lens, both after the motion.
    covariance: Matrix
    information: Matrix  # (6, 6), of the same, as if the errors of regions were independent
    inliers: int
    share: float  # of inliers among the regions with a displacement; in (0, 1]
    cells_per_m: float  # displacement of a region of median depth by a translation across
    baseline_m: float = math.inf  # between the images that gave the depths
    # (k, 3), positions of these images from the reference's lens.
    neighbours: Doubles = field(default_factory=lambda: np.zeros((0, 3)))


def align(
    structure: Structure, sight: Sight, precision: Precision = ALIGNMENT.cells
) -> Alignment | None:
    """Return the motion to the lens of a sight, starting at its guess; None if few agree."""
    observed, scale = sight.observed, sight.scale
    known = np.isfinite(observed).all(axis=1) & (structure.information > 0)
    if known.sum() < precision.fewest:
        return None
    used = Structure(
        structure.rays[known], structure.inverse_m[known], structure.information[known]
    )
    moved, inverse, off, pulls, information = fitted(
        used, observed[known], scale, np.array(precision.sigmas), sight.moved
    )
    agreeing = int((np.hypot(*off.T) <= precision.agreeing).sum())
    if agreeing < precision.fewest or not np.isfinite(moved).all():
        return None
    cells_per_m = float(np.median(inverse) * scale.mean())
    if (share := agreeing / len(inverse)) < precision.least_share:
        return None
    # Errors of neighbours are correlated: gradients are summed over squares of regions.
    squares = _squares(np.flatnonzero(known), len(known), precision.block)
    sums = np.stack([np.bincount(squares, gradient) for gradient in pulls.T])
    least = np.linalg.inv(information)
    covariance = least @ (information + sums @ sums.T) @ least
    return Alignment(moved, covariance, information, agreeing, share, cells_per_m)


def fitted(
    known: Structure, observed: Doubles, scale: Doubles, sigmas: Doubles, start: Doubles
) -> tuple[Doubles, Doubles, Doubles, Doubles, Doubles]:
    """
    Fit a motion (4, 4), starting at `start`, and n depths to regions that another lens sees.

    There is one round of least squares for each sigma, in cells; larger errors weigh less.
    `observed` (n, 2) is in the plane z = 1, `scale` (2,) cells across and down per length of 1.
    Return the motion, inverse depths (n,), errors in cells (n, 2), gradients by the pose (n, 6),
    and the information about the pose (6, 6), of a turn and a translation.
    """
    # Values of a region lie in a column: sums over contiguous memory are faster.
    rays, observed, across_down = known.rays.T, observed.T, scale[:, None]
    given, held = known.inverse_m, known.information
    inverse, moved = given, start.copy()
    for sigma in sigmas:
        turned = moved[:3, :3] @ rays
        points = turned + inverse * moved[:3, 3:]
        ahead = np.maximum(points[2], DEPTH.least_ahead)
        flat = points[:2] / ahead
        off = (flat - observed) * across_down
        by_pose, by_depth = _slopes(turned, inverse, moved[:3, 3:], flat, across_down / ahead)
        weight = (points[2] > DEPTH.least_ahead) / (sigma**2 + (off**2).sum(axis=0))
        # Depths are eliminated by the Schur complement, which is a scalar for each.
        own = held + weight * (by_depth**2).sum(axis=0)
        pull = held * (inverse - given) + weight * (by_depth * off).sum(axis=0)
        both = weight * (by_pose * by_depth).sum(axis=1)
        pulls = (by_pose * weight * off).sum(axis=1) - both * (pull / own)
        rows = (by_pose * weight).reshape(6, -1)
        information = rows @ by_pose.reshape(6, -1).T - (both / own) @ both.T
        information[np.diag_indices(6)] += DEPTH.no_motion
        step = -np.linalg.solve(information, pulls.sum(axis=1))
        inverse = (inverse - (pull + step @ both) / own).clip(0.0, 1 / DEPTH.least_ahead)
        moved[:3, :3] = turned_by(step[:3]) @ moved[:3, :3]
        moved[:3, 3] += step[3:]
    return moved, inverse, off.T, pulls.T, information


def _slopes(
    turned: Doubles, inverse: Doubles, translation: Doubles, flat: Doubles, scale: Doubles
) -> tuple[Doubles, Doubles]:
    """Return derivatives of positions by turns and translations (6, 2, n), by depths (2, n)."""
    (x, y, z), (u, v) = turned, flat
    zero = np.zeros_like(x)
    across = -u * y, z + u * x, -y, inverse, zero, -u * inverse
    down = -z - v * y, v * x, x, zero, inverse, -v * inverse
    by_pose = np.stack((across, down), axis=1) * scale
    return by_pose, (translation[:2] - flat * translation[2]) * scale


def start_by_points(structure: Structure, sight: Sight) -> Matrix | None:
    """Return the motion to a lens by SQPnP and RANSAC on precise depths; None if that fails."""
    deviations = structure.inverse_m * np.sqrt(structure.information)
    known = np.isfinite(sight.observed).all(axis=1) & (deviations > ALIGNMENT.least_depth_sigmas)
    if known.sum() < ALIGNMENT.fewest_points:
        return None
    points = structure.rays[known] / structure.inverse_m[known, None]
    lens, moved = np.diag([*sight.scale, 1.0]), np.eye(4)
    with suppress(cv2.error):
        is_found, turn, translation, _ = cv2.solvePnPRansac(
            points,
            sight.observed[known] * sight.scale,
            lens,
            None,
            iterationsCount=ALIGNMENT.samples,
            reprojectionError=1.0,
            confidence=ALIGNMENT.probability,
            flags=cv2.SOLVEPNP_SQPNP,
        )
        if is_found and np.isfinite(turn).all() and np.isfinite(translation).all():
            moved[:3, :3], moved[:3, 3] = turned_by(turn), translation.ravel()
            return moved
    return None


def correct_parallax_loss(found: Alignment, along: Doubles) -> Alignment:
    """
    Return a motion with a corrected part across the map's drive, and the turn that compensates it.

    Large parallax is underestimated: the field is smoothed, and near regions leave the search.
    Along the line to the neighbours, whose parallax gave the depths, the error cancels. Across it,
    the missing part was taken for a turn.
    `along` is that line in the reference's lens, a unit vector (3,).
    """
    translation, information = found.moved[:3, 3], found.information
    ahead = found.moved[:3, :3] @ along
    across = translation - (translation @ ahead) * ahead
    missed = ALIGNMENT.shrunk * found.cells_per_m * float(np.linalg.norm(across)) * across
    turn = -np.linalg.solve(information[:3, :3], information[:3, 3:] @ missed)
    moved = found.moved.copy()
    moved[:3, :3] = turned_by(turn) @ moved[:3, :3]
    moved[:3, 3] += missed
    return replace(found, moved=moved)


def _squares(regions: npt.NDArray[np.intp], count: int, side: int) -> npt.NDArray[np.intp]:
    """Return the square, with a side in regions, that each region (n,) of `count` lies in."""
    if side == 1:
        return np.arange(len(regions))
    rows, columns = np.divmod(regions, math.isqrt(count))
    return rows // side * count + columns // side


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
