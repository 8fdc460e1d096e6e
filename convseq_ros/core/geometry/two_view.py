# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The motion between two lenses without depth: the essential matrix gives rotation and direction.

It is weak: in a coarse field of distant things, a turn and a step to the side look the same.
"""

from dataclasses import dataclass

from convseq_ros.core.geometry.alignment import ALIGNMENT
from convseq_ros.core.geometry.lens import Points
from convseq_ros.core.geometry.structure import DEPTH
from convseq_ros.core.rigid import Matrix
from convseq_ros.core.types import constants, Doubles
import cv2
import numpy as np


@constants
class TWO_VIEW:
    """Engineering; only the error of the field was measured."""

    fewest: int = 60  # least number of inliers
    rounds: int = 5  # of the fit of a turn alone
    still_cells: float = 0.5  # median error of a turn alone, below which there is no translation


@dataclass(frozen=True, eq=False, slots=True)
class TwoView:
    """The motion between two lenses without scale; equal to itself only."""

    turned: Matrix  # (3, 3), from the first lens to the second
    direction: Doubles | None  # of the second lens in the first, (3,); None without a baseline
    inliers: int
    share: float  # of inliers among the regions with a displacement; in (0, 1]


def two_view(first: Points, second: Points, scale: Doubles) -> TwoView | None:
    """Return the motion between lenses that see the same regions (n, 2); None if few agree."""
    known = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    first, second = first[known], second[known]
    if len(first) < TWO_VIEW.fewest:
        return None
    turned, left = _turn(first, second, scale)
    if np.median(left) < TWO_VIEW.still_cells:
        agree = left <= 2 * TWO_VIEW.still_cells
        return TwoView(turned, None, int(agree.sum()), float(agree.mean()))
    # The usual distance from the epipolar line is a tenth of a cell.
    threshold = DEPTH.sigma_cells / float(np.sqrt(scale.prod()))
    options = np.eye(3), cv2.RANSAC, ALIGNMENT.probability, threshold
    essential, agree = cv2.findEssentialMat(first, second, *options)
    if essential is None or essential.shape != (3, 3):
        return None
    count, turned, translation, _ = cv2.recoverPose(
        essential, first, second, np.eye(3), mask=agree
    )
    if count < TWO_VIEW.fewest:
        return None
    return TwoView(turned, -turned.T @ translation.ravel(), int(count), count / len(first))


def _turn(first: Points, second: Points, scale: Doubles) -> tuple[Matrix, Doubles]:
    """Return the rotation between rays, robust to outliers, and its errors (n,) in cells."""
    rays = [np.column_stack((observed, np.ones(len(observed)))) for observed in (first, second)]
    here, there = (ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in rays)
    weight = np.ones(len(first))
    for _ in range(TWO_VIEW.rounds):
        left, _, right = np.linalg.svd((there * weight[:, None]).T @ here)
        turned = left @ np.diag((1.0, 1.0, np.linalg.det(left @ right))) @ right
        straight = rays[0] @ turned.T
        off = np.hypot(*((straight[:, :2] / straight[:, 2:] - second) * scale).T)
        weight = 1 / (1 + (off / TWO_VIEW.still_cells) ** 2)
    return turned, off
