# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Rays of regions, and their depths by triangulation with neighbouring places of the same drive.

The motion between neighbours comes from the map's poses; so a single camera gets its scale from
the odometry that made the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from convseq_ros.core.encoding.regions import REGION
from convseq_ros.core.rigid import Matrix
from convseq_ros.core.types import Camera, COEFFICIENTS, constants, Doubles
import cv2
import numpy as np

Points = Doubles  # (n, 2), each NaN where it is not known


@constants
class LENS:
    """Limits of lenses; engineering, not studied."""

    # Largest error of a ray that is distorted again, as a share of the image: 0.05 of 32 cells;
    error_share: float = 0.05 / 32  # a displacement field has 0.1
    widest: float = 5.7  # tangent of 80 degrees from the axis; rays further out are not used


def is_usable(camera: Camera) -> bool:
    """Return whether a camera's parameters are finite, positive and of a supported model."""
    sizes = camera.width_px, camera.height_px, camera.fx_px, camera.fy_px
    numbers = np.array([*sizes, camera.cx_px, camera.cy_px, *camera.distortion], np.float64)
    lengths = COEFFICIENTS.get(camera.distortion_model, ())
    is_known = not camera.distortion or len(camera.distortion) in lengths
    return is_known and bool(np.isfinite(numbers).all()) and min(sizes) > 0


def rays(camera: Camera, places: Points, side: int) -> Points:
    """
    Return where the rays of regions at `places` (n, 2), rows and columns in cells, meet z = 1.

    The result (n, 2) is x to the right and y down. It is NaN where the place is not known, the
    distortion cannot be inverted, or the ray is further than 80 degrees from the axis.
    """
    return rays_through(camera, (places[:, ::-1] + REGION.span / 2) / (side + REGION.span - 1))


def rays_through(camera: Camera, shares: Points) -> Points:
    """Return `rays` for places across and down, as shares of the image."""
    # The middle of the first pixel is at 0.
    middle = shares * (camera.width_px, camera.height_px) - 0.5
    matrix = np.array(
        [[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]]
    )
    if not any(camera.distortion):
        found = (middle - matrix[:2, 2]) / (camera.fx_px, camera.fy_px)
    else:
        error_px = LENS.error_share * min(camera.width_px, camera.height_px)
        found = _undistorted(camera, middle, matrix, error_px)
    with np.errstate(invalid='ignore'):
        found[~(abs(found) < LENS.widest).all(axis=1)] = np.nan
    return np.asarray(found)


def _undistorted(camera: Camera, pixels: Points, matrix: Points, error_px: float) -> Points:
    """Return rays of pixels; NaN where a ray, distorted again, misses its pixel."""
    found = np.full_like(pixels, np.nan)
    known = np.isfinite(pixels).all(axis=1)
    observed, numbers = pixels[known][None], np.array(camera.distortion)
    if not known.any():
        return found
    if camera.distortion_model == 'equidistant':
        straight = cv2.fisheye.undistortPoints(observed, matrix, numbers)
        again = cv2.fisheye.distortPoints(straight, matrix, numbers)
    else:
        straight = cv2.undistortPoints(observed, matrix, numbers)
        deep = cv2.convertPointsToHomogeneous(straight[:, 0])
        again, _ = cv2.projectPoints(deep, np.zeros(3), np.zeros(3), matrix, numbers)
    off = np.linalg.norm(again.reshape(-1, 2) - observed[0], axis=1)
    found[known] = np.where((off <= error_px)[:, None], straight.reshape(-1, 2), np.nan)
    return found


@constants
class DEPTH:
    """Triangulation; tuned on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    nearest_m: float = 1.5  # the initial guesses span this depth ...
    furthest_m: float = 200.0  # ... to this one
    guesses: int = 14  # number of guesses, evenly spread in the logarithm of the depth
    rounds: int = 4  # of the refinement
    sigma_cells: float = 0.3  # of a displacement; larger errors weigh less (Cauchy)
    # In square metres: below, a depth counts as unknown. A sigma of 1 per m of inverse depth.
    least_information: float = 1.0
    no_motion: float = 1e-6  # added to the information of a motion, so that it can be inverted
    least_ahead: float = 0.05  # smallest z per ray: no point is at the lens or behind it
    # Sigma of a measured depth, as a share of it: sensor noise, and depths mixed in a region.
    measured_share: float = 0.1
    # Share of the median depth; nearer regions move beyond the search and are not used.
    nearest_share: float = 0.5
    usual_inverse_m: float = 0.05  # assumed for regions of unknown depth, to guess their motion


@dataclass(frozen=True, eq=False, slots=True)
class Structure:
    """The regions of a reference in space; equal to itself only."""

    rays: Doubles  # (n, 3), with z = 1
    inverse_m: Doubles  # (n,), inverse depths, per metre
    information: Doubles  # (n,), inverse variances of `inverse_m`, square metres; 0 if unknown


# Motion, inverse depths, errors, pulls and information: see `numpy_kernels.align`.
Fit = tuple[Doubles, Doubles, Doubles, Doubles, Doubles]


@dataclass(frozen=True, eq=False, slots=True)
class Sight:
    """Where another image sees the same regions; equal to itself only."""

    observed: Points  # (n, 2), where their rays meet the other image's plane z = 1
    moved: Matrix  # (4, 4), from the reference's lens to the other's; known or a guess
    scale: Doubles  # (2,), cells across and down per length of 1 in that plane


def triangulate(rays: Doubles, sights: Sequence[Sight]) -> Structure:
    """Return rays (n, 3) with the depths that agree best with the sights of neighbours."""
    guesses = 1 / np.geomspace(DEPTH.nearest_m, DEPTH.furthest_m, DEPTH.guesses)
    costs = np.zeros((len(guesses), len(rays)))
    for sight in sights:
        off, _ = _off(sight, rays, guesses[:, None])
        with np.errstate(invalid='ignore'):
            costs += np.nan_to_num(np.log1p((off**2).sum(axis=-2) / DEPTH.sigma_cells**2))
    inverse = guesses[costs.argmin(axis=0)]
    information = np.zeros(len(rays))
    for _ in range(DEPTH.rounds):
        slopes = np.zeros(len(rays))
        information[:] = 0
        for sight in sights:
            off, slope = _off(sight, rays, inverse)
            weight = 1 / (DEPTH.sigma_cells**2 + (off**2).sum(axis=0))
            slopes += np.nan_to_num(weight * (slope * off).sum(axis=0))
            information += np.nan_to_num(weight * (slope**2).sum(axis=0))
        step = slopes / np.maximum(information, DEPTH.least_information)
        inverse = (inverse - step).clip(0.0, 1 / DEPTH.nearest_m)
    information[information < DEPTH.least_information] = 0
    return Structure(rays, inverse, information)


def with_depths(rays: Doubles, depths_m: Doubles) -> Structure:
    """Return rays (n, 3) with measured depths (n,); NaN and much too near ones are unknown."""
    nearest_m = DEPTH.nearest_share * float(np.nanmedian(depths_m))
    with np.errstate(invalid='ignore'):
        used = depths_m >= nearest_m
    inverse = np.where(used, 1 / np.where(used, depths_m, 1.0), 0.0)
    information = np.where(used, (depths_m / DEPTH.measured_share) ** 2, 0.0)
    return Structure(rays, inverse, information)


def _off(sight: Sight, rays: Doubles, inverse: Doubles) -> tuple[Doubles, Doubles]:
    """
    Return errors of projected points, in cells, and their derivatives by inverse depth.

    Both are (2, n), or (m, 2, n) for inverse depths (m, 1): this layout makes sums fast.
    """
    turned, translation = sight.moved[:3, :3] @ rays.T, sight.moved[:3, 3:]
    points = turned + inverse[..., None, :] * translation
    ahead = np.maximum(points[..., 2:, :], DEPTH.least_ahead)
    flat, scale = points[..., :2, :] / ahead, sight.scale[:, None]
    return (flat - sight.observed.T) * scale, (
        translation[:2] - flat * translation[2]
    ) / ahead * scale
