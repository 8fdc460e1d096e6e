# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The depths of regions, by triangulation with neighbouring places of the same drive.

The motion between neighbours comes from the map's poses; so a single camera gets its scale from
the odometry that made the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from convseq_ros.core.geometry.lens import Points
from convseq_ros.core.rigid import Matrix
from convseq_ros.core.types import constants, Doubles
import numpy as np


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
    usual_inverse_m: float = 0.05  # assumed for regions of unknown depth, to guess their motion


@dataclass(frozen=True, eq=False, slots=True)
class Structure:
    """The regions of a reference in space; equal to itself only."""

    rays: Doubles  # (n, 3), with z = 1
    inverse_m: Doubles  # (n,), inverse depths, per metre
    information: Doubles  # (n,), inverse variances of `inverse_m`, square metres; 0 if unknown


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
