# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Displacements and their motion, in C: kernels.c; `numpy_kernels` has the same."""

from convseq_ros.core.compiled import array, DOUBLE, FLOAT, kernel, SIZE
from convseq_ros.core.geometry.displacement import Arranged, Displacements, FIELD, weights
from convseq_ros.core.geometry.motion import initial_motion, MOTION, Motion
import numpy as np

_displacements = kernel(
    'displacements', array('f4'), array('f4'), SIZE, SIZE, SIZE, SIZE, array('f4'), SIZE, FLOAT,
    array('f4'), array('i8'),
)  # fmt: skip
_fit_motion = kernel(
    'fit_motion', array('f4'), SIZE, SIZE, DOUBLE, SIZE, DOUBLE, array('f8'), array('f8')
)
_WEIGHTS = weights()


def displacements(query: Arranged, reference: Arranged, start: tuple[int, int]) -> Displacements:
    """Return what `numpy_kernels.displacements` does, to 1e-4 cells."""
    found, kept = np.empty((query.side**2, 5), np.float32), np.zeros(1, np.int64)
    _displacements(
        query.numbers, reference.numbers, query.side, *start, FIELD.reach_cells,
        _WEIGHTS, FIELD.radius_cells, FIELD.tolerance_cells, found, kept,
    )  # fmt: skip
    return found[: kept[0]]


def fit_motion(found: Displacements, side: int, start: tuple[int, int]) -> Motion:
    """Return what `numpy_kernels.fit_motion` does, to 1e-6 cells."""
    motion, off = initial_motion(start), np.empty(len(found))
    sigma, stiffness = MOTION.sigma_cells, MOTION.stiffness
    _fit_motion(found, len(found), side, sigma, MOTION.rounds, stiffness, motion, off)
    return motion, off
