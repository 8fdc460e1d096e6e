# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Rotation and direction of two images, where no depth is known: the essential matrix.

It is weak: to a coarse field of distant things a turn and a step to the side look alike.
"""

from dataclasses import dataclass

from convseq_ros.core.constants import constants
from convseq_ros.core.geometry.lens import Points
from convseq_ros.core.rigid import Matrix
from convseq_ros.core.types import Doubles
import cv2
import numpy as np


@constants
class TWO_VIEW:
    """Engineering, but for the field's error, which was measured."""

    threshold_cells: float = 0.3  # off the epipolar line; a tenth is usual
    probability: float = 0.999  # of a sample without outliers; OpenCV's samples are always alike
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
    threshold = TWO_VIEW.threshold_cells / float(np.sqrt(scale.prod()))
    options = np.eye(3), cv2.RANSAC, TWO_VIEW.probability, threshold
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
