# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where a lens was that saw a reference's regions: robust least squares over all of them.

Depths are not exact, and those of far regions are hardly known: so they move along, each held to
its own as surely as it is known, and what a region says of the pose counts for no more than that.
The search starts at a given pose, wide at first; for keypoints also at one of samples.

Where no depth is known, the essential matrix tells rotation and direction. It is weak: to a coarse
field of distant things a turn and a step to the side look alike.
"""

from contextlib import suppress
from dataclasses import dataclass, field, replace
import math

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.geometry.structure import DEPTH, Points, Sight, Structure
from convseq_ros.core.rigid import Matrix, turned_by
from convseq_ros.core.types import constants, Doubles
import cv2
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class Precision:
    """How exactly what is aligned was seen, in its unit: cells, or that of keypoints."""

    sigmas: tuple[float, ...]  # of the rounds of least squares
    agreeing: float  # within which something agrees with a pose
    fewest: int  # that must agree
    least_share: float = 0.0  # of what was found, that must agree
    alike: int = 1  # regions a side of a square whose errors are taken together


@constants
class ALIGNMENT:
    """Chosen on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    # Of regions; of unrelated images less than 40 agree.
    cells: Precision = Precision(sigmas=(1.0,) * 4 + (0.3,) * 7, agreeing=0.6, fewest=40, alike=3)
    # Of the way across, which the field misses, for each cell that it moves the middle region.
    shrunk: float = 0.08  # fitted on drawn streets
    # Of a start by points in space: deviations of a depth that tells how far its point is, and
    # how many samples; OpenCV's are always alike.
    least_depth_sigmas: float = 3.0
    samples: int = 200
    # Of all samples: of one without outliers, and from how many points.
    probability: float = 0.999
    fewest_points: int = 8


@dataclass(frozen=True, eq=False, slots=True)
class Alignment:
    """A pose and how surely it is known; equal to itself only."""

    moved: Matrix  # (4, 4), from the reference's lens to the other
    # (6, 6), of a turn, and of a way, in the other lens, both after the motion.
    covariance: Matrix
    information: Matrix  # (6, 6), the same as least squares counts it: as if each erred alone
    inliers: int
    share: float  # of the regions that were found, inliers; in (0, 1]
    cells_per_m: float  # by which a way across moves a region of middle depth
    baseline_m: float = math.inf  # between the images that gave the depths
    # (k, 3), where those images were taken, from the reference's lens.
    neighbours: Doubles = field(default_factory=lambda: np.zeros((0, 3)))
    first_share: float | None = None  # before regions were followed, if they were


def align(
    structure: Structure, sight: Sight, precision: Precision = ALIGNMENT.cells
) -> Alignment | None:
    """Return the motion to a lens that saw regions, about the sight's; None if few agree."""
    seen, scale = sight.seen, sight.scale
    known = np.isfinite(seen).all(axis=1) & (structure.information > 0)
    if known.sum() < precision.fewest:
        return None
    used = Structure(
        structure.rays[known], structure.inverse_m[known], structure.information[known]
    )
    moved, inverse, off, pulls, information = kernels_of(__package__).align(
        used, seen[known], scale, np.array(precision.sigmas), sight.moved
    )
    agreeing = int((np.hypot(*off.T) <= precision.agreeing).sum())
    if agreeing < precision.fewest or not np.isfinite(moved).all():
        return None
    cells_per_m = float(np.median(inverse) * scale.mean())
    if (share := agreeing / len(inverse)) < precision.least_share:
        return None
    # What pulls at the pose, summed over neighbours, tells how far they pull together.
    squares = _squares(np.flatnonzero(known), len(known), precision.alike)
    sums = np.stack([np.bincount(squares, one) for one in pulls.T])
    least = np.linalg.inv(information)
    covariance = least @ (information + sums @ sums.T) @ least
    return Alignment(moved, covariance, information, agreeing, share, cells_per_m)


def start_by_points(structure: Structure, sight: Sight) -> Matrix | None:
    """Return the motion to a lens by SQPnP and RANSAC on well-known depths; None if that fails."""
    deviations = structure.inverse_m * np.sqrt(structure.information)
    known = np.isfinite(sight.seen).all(axis=1) & (deviations > ALIGNMENT.least_depth_sigmas)
    if known.sum() < ALIGNMENT.fewest_points:
        return None
    points = structure.rays[known] / structure.inverse_m[known, None]
    lens, moved = np.diag([*sight.scale, 1.0]), np.eye(4)
    with suppress(cv2.error):
        is_found, turn, way, _ = cv2.solvePnPRansac(
            points,
            sight.seen[known] * sight.scale,
            lens,
            None,
            iterationsCount=ALIGNMENT.samples,
            reprojectionError=1.0,
            confidence=ALIGNMENT.probability,
            flags=cv2.SOLVEPNP_SQPNP,
        )
        if is_found and np.isfinite(turn).all() and np.isfinite(way).all():
            moved[:3, :3], moved[:3, 3] = turned_by(turn), way.ravel()
            return moved
    return None


def unshrunk(found: Alignment, along: Doubles | None) -> Alignment:
    """
    Return a motion whose way across the map's is longer, and the turn that fits to it.

    Large parallax comes out too small: the field is smoothed, and what is near leaves the search.
    Along the way to the neighbours, whose parallax gave the depths, that cancels; across it, what
    is missing was taken for a turn.
    `along` is that way in the reference's lens, a unit vector (3,); None if depths were measured.
    """
    way, information = found.moved[:3, 3], found.information
    across = way
    if along is not None:
        ahead = found.moved[:3, :3] @ along
        across = way - (way @ ahead) * ahead
    missed = ALIGNMENT.shrunk * found.cells_per_m * float(np.linalg.norm(across)) * across
    turn = -np.linalg.solve(information[:3, :3], information[:3, 3:] @ missed)
    moved = found.moved.copy()
    moved[:3, :3] = turned_by(turn) @ moved[:3, :3]
    moved[:3, 3] += missed
    return replace(found, moved=moved)


def _squares(regions: npt.NDArray[np.intp], count: int, side: int) -> npt.NDArray[np.intp]:
    """Return in which square of so many regions a side regions (n,) of a square image lie."""
    if side == 1:
        return np.arange(len(regions))
    rows, columns = np.divmod(regions, math.isqrt(count))
    return rows // side * count + columns // side


@constants
class TWO_VIEW:
    """Engineering, but for the field's error, which was measured."""

    fewest: int = 60  # regions that must agree
    rounds: int = 5  # of the fit of a turn alone
    still_cells: float = 0.5  # median of what a turn alone leaves, below which there is no way


@dataclass(frozen=True, eq=False, slots=True)
class TwoView:
    """What two images say of the motion between their lenses; equal to itself only."""

    turned: Matrix  # (3, 3), from the first lens to the second
    direction: Doubles | None  # of the second lens in the first, (3,); None without a baseline
    inliers: int
    share: float  # of the regions that were found, inliers; in (0, 1]


def two_view(first: Points, second: Points, scale: Doubles) -> TwoView | None:
    """Return the motion between lenses that saw (n, 2) each, by cells; None if few agree."""
    known = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    first, second = first[known], second[known]
    if len(first) < TWO_VIEW.fewest:
        return None
    turned, left = _turn(first, second, scale)
    if np.median(left) < TWO_VIEW.still_cells:
        agree = left <= 2 * TWO_VIEW.still_cells
        return TwoView(turned, None, int(agree.sum()), float(agree.mean()))
    # Off the epipolar line a tenth of a cell is usual.
    threshold = DEPTH.sigma_cells / float(np.sqrt(scale.prod()))
    options = np.eye(3), cv2.RANSAC, ALIGNMENT.probability, threshold
    essential, agree = cv2.findEssentialMat(first, second, *options)
    if essential is None or essential.shape != (3, 3):
        return None
    count, turned, way, _ = cv2.recoverPose(essential, first, second, np.eye(3), mask=agree)
    if count < TWO_VIEW.fewest:
        return None
    return TwoView(turned, -turned.T @ way.ravel(), int(count), count / len(first))


def _turn(first: Points, second: Points, scale: Doubles) -> tuple[Matrix, Doubles]:
    """Return the rotation between rays, what is far off counting less, and what is left (n,)."""
    rays = [np.column_stack((seen, np.ones(len(seen)))) for seen in (first, second)]
    one, other = (ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in rays)
    weight = np.ones(len(first))
    for _ in range(TWO_VIEW.rounds):
        left, _, right = np.linalg.svd((other * weight[:, None]).T @ one)
        turned = left @ np.diag((1.0, 1.0, np.linalg.det(left @ right))) @ right
        straight = rays[0] @ turned.T
        off = np.hypot(*((straight[:, :2] / straight[:, 2:] - second) * scale).T)
        weight = 1 / (1 + (off / TWO_VIEW.still_cells) ** 2)
    return turned, off
