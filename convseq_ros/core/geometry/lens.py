# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lenses: the rays on which regions and keypoints lie."""

from convseq_ros.core.encoding.regions import REGION
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
    try:
        numbers = np.array([*sizes, camera.cx_px, camera.cy_px, *camera.distortion], np.float64)
    except OverflowError:  # an integer, in a map's JSON, beyond all floats
        return False
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
    if not any(camera.distortion):
        found = (middle - (camera.cx_px, camera.cy_px)) / (camera.fx_px, camera.fy_px)
    else:
        error_px = LENS.error_share * min(camera.width_px, camera.height_px)
        found = _undistorted(camera, middle, error_px)
    with np.errstate(invalid='ignore'):
        found[~(abs(found) < LENS.widest).all(axis=1)] = np.nan
    return np.asarray(found)


def pixels(camera: Camera, rays: Points) -> Points:
    """Return where a camera sees rays (n, 2) that meet z = 1: across, down; NaN stays NaN."""
    numbers, known = np.array(camera.distortion), np.nan_to_num(rays)[None]
    if camera.distortion_model == 'equidistant':
        found = cv2.fisheye.distortPoints(known, _matrix(camera), numbers)
    else:
        deep, still = cv2.convertPointsToHomogeneous(known[0]), np.zeros(3)
        found, _ = cv2.projectPoints(deep, still, still, _matrix(camera), numbers)
    return np.where(np.isnan(rays), np.nan, np.reshape(found, rays.shape))


def _matrix(camera: Camera) -> Doubles:
    return np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])


def _undistorted(camera: Camera, places: Points, error_px: float) -> Points:
    """Return rays of pixels; NaN where a ray, distorted again, misses its pixel."""
    found = np.full_like(places, np.nan)
    known = np.isfinite(places).all(axis=1)
    observed, numbers = places[known][None], np.array(camera.distortion)
    if not known.any():
        return found
    how = cv2.fisheye if camera.distortion_model == 'equidistant' else cv2
    straight = how.undistortPoints(observed, _matrix(camera), numbers).reshape(-1, 2)
    off = np.linalg.norm(pixels(camera, straight) - observed[0], axis=1)
    found[known] = np.where((off <= error_px)[:, None], straight, np.nan)
    return found
