# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How far a path is from the truth."""

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]  # (N, 2): x, y in metres; of two paths at the same times


def aligned(estimate: Points, truth: Points) -> Points:
    """Return a path, turned and moved as a whole (SE2, no scale) to lie nearest to the truth."""
    centre, true_centre = estimate.mean(axis=0), truth.mean(axis=0)
    left, _, right = np.linalg.svd((truth - true_centre).T @ (estimate - centre))
    flip = np.diag((1.0, np.sign(np.linalg.det(left @ right))))
    moved: Points = (estimate - centre) @ (left @ flip @ right).T + true_centre
    return moved


def rmse_m(estimate: Points, truth: Points) -> float:
    """Return the root mean square distance of paths of shape (N, 2), metres, as they lie."""
    return float(np.sqrt(np.mean(np.sum((estimate - truth) ** 2, axis=1))))


def absolute_error_m(estimate: Points, truth: Points) -> float:
    """Return the absolute trajectory error: the distance that is left after alignment."""
    return rmse_m(aligned(estimate, truth), truth)
