# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which places of a map are near a pose that others tell."""

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Doubles, Indices, PoseEstimate
import numpy as np


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
