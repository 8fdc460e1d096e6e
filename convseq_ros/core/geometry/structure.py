# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How deep the regions of a reference lie, by neighbours of its own drive, whose way is known.

What is found in two images of one drive, a known way apart, is triangulated; so a single camera
gets its scale from the odometry that made the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isqrt

from convseq_ros.core.constants import constants
from convseq_ros.core.geometry.lens import Points
from convseq_ros.core.rigid import Matrix
from convseq_ros.core.types import Doubles
import cv2
import numpy as np


@constants
class DEPTH:
    """Of the triangulation; chosen on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    nearest_m: float = 1.5  # of the first guesses ...
    furthest_m: float = 200.0
    guesses: int = 14  # ... evenly spread by their logarithm
    rounds: int = 4  # of the refinement
    sigma_cells: float = 0.3  # of a displacement; what is further off counts less (Cauchy)
    # Information of a depth, in square metres, that stands for none: 1 per m of inverse depth.
    least_information: float = 1.0
    no_motion: float = 1e-6  # information of none, where a motion is fitted
    least_ahead: float = 0.05  # in a ray's length: a point is not at the lens, nor behind it
    # Deviation of a measured depth, as a share of it: what a camera errs, and a region mixes.
    measured_share: float = 0.1
    # Of the median, below which a measured depth is not used: what is near leaves the search.
    nearest_share: float = 0.5
    usual_inverse_m: float = 0.05  # of regions of unknown depth, to guess where they went
    smooth_regions: float = 1.5  # sigma of a Gaussian over neighbours' depths; 2.5 is alike


@dataclass(frozen=True, eq=False, slots=True)
class Structure:
    """The regions of a reference in space; equal to itself only."""

    rays: Doubles  # (n, 3), z is 1
    inverse_m: Doubles  # (n,), inverse depths
    information: Doubles  # (n,), of these: inverse variances, in square metres; 0 where unknown


# What `align` of a kernel finds.
Fit = tuple[Doubles, Doubles, Doubles, Doubles, Doubles]


@dataclass(frozen=True, eq=False, slots=True)
class Sight:
    """What another image saw of the same regions; equal to itself only."""

    seen: Points  # (n, 2), where their rays meet its plane
    moved: Matrix  # (4, 4), from the reference's lens to its lens
    scale: Doubles  # (2,), cells across and down for a length of 1 in its plane


def triangulate(rays: Doubles, sights: Sequence[Sight]) -> Structure:
    """Return the depths of rays (n, 3) that agree best with what neighbours saw of them."""
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


def smoothed(structure: Structure) -> Doubles:
    """Return inverse depths (n,) of the regions of a square image, as their neighbours are."""
    side = isqrt(len(structure.rays))
    weight = structure.information.reshape(side, side)
    images = weight * structure.inverse_m.reshape(side, side), weight
    sums, weights = (cv2.GaussianBlur(one, (0, 0), DEPTH.smooth_regions).ravel() for one in images)
    own = DEPTH.least_information
    return np.asarray((sums + own * DEPTH.usual_inverse_m) / (weights + own))


def measured(rays: Doubles, depths_m: Doubles) -> Structure:
    """Return rays (n, 3) with depths (n,) that were measured; NaN is unknown."""
    nearest_m = DEPTH.nearest_share * float(np.nanmedian(depths_m))
    with np.errstate(invalid='ignore'):
        used = depths_m >= nearest_m
    inverse = np.where(used, 1 / np.where(used, depths_m, 1.0), 0.0)
    information = np.where(used, (depths_m / DEPTH.measured_share) ** 2, 0.0)
    return Structure(rays, inverse, information)


def _off(sight: Sight, rays: Doubles, inverse: Doubles) -> tuple[Doubles, Doubles]:
    """
    Return how far off what was seen points are, in cells, and by how much more per 1 / m.

    Both (2, n), or (m, 2, n) for inverse depths (m, 1): sums over neighbours in memory are faster.
    """
    turned, way = sight.moved[:3, :3] @ rays.T, sight.moved[:3, 3:]
    points = turned + inverse[..., None, :] * way
    ahead = np.maximum(points[..., 2:, :], DEPTH.least_ahead)
    flat, scale = points[..., :2, :] / ahead, sight.scale[:, None]
    return (flat - sight.seen.T) * scale, (way[:2] - flat * way[2]) / ahead * scale
