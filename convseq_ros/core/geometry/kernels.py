# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Displacements and motions in C (kernels.c), defined by `numpy_kernels`."""

from collections.abc import Sequence

from convseq_ros.core.compiled import address, Array, DOUBLE, FLOAT, kernel, SIZE
from convseq_ros.core.encoding.regions import Regions
from convseq_ros.core.geometry.verification import (
    Displacements,
    FIELD,
    initial_motion,
    Motion,
    MOTION_FIT,
    PackedRegions,
    weights,
)
from convseq_ros.core.types import Doubles
import numpy as np
import numpy.typing as npt

_WORDS, _FLOATS, _DOUBLES, _WHOLES = Array('i4'), Array('f4'), Array('f8'), Array('i8')
_arrange = kernel('arrange', _FLOATS, SIZE, FLOAT, _WORDS)
_displacements = kernel(
    'displacements', _WORDS, _WORDS, SIZE, SIZE, SIZE, FLOAT, _FLOATS, FLOAT, _FLOATS, _WHOLES
)
_fit_motion = kernel('fit_motion', _FLOATS, SIZE, SIZE, DOUBLE, SIZE, DOUBLE, _DOUBLES, _DOUBLES)
_verify = kernel(
    'verify', _WORDS, Array('u8'), SIZE, SIZE, _WHOLES, FLOAT, _FLOATS, FLOAT, DOUBLE, SIZE,
    DOUBLE, _DOUBLES,
)  # fmt: skip
_OF_FIELD = 1 / FIELD.scale**2, weights(), FIELD.tolerance_cells
_OF_MOTION = MOTION_FIT.sigma_cells, MOTION_FIT.rounds, MOTION_FIT.stiffness


def arrange(regions: Regions, rows: npt.NDArray[np.int32]) -> None:
    """Lay out regions as `numpy_kernels.arrange` does."""
    _arrange(np.ascontiguousarray(regions, np.float32), len(rows), FIELD.scale, rows)


def displacements(
    query: PackedRegions, reference: PackedRegions, start: tuple[int, int]
) -> Displacements:
    """Return `numpy_kernels.displacements`, to 1e-4 cells."""
    rows, count = np.empty((query.side**2, 5), np.float32), np.zeros(1, np.int64)
    _displacements(query.rows, reference.rows, query.side, *start, *_OF_FIELD, rows, count)
    return rows[: count[0]]


def fit_motion(found: Displacements, side: int, start: tuple[int, int]) -> Motion:
    """Return `numpy_kernels.fit_motion`, to 1e-6 cells."""
    motion, off = initial_motion(start), np.empty(len(found))
    _fit_motion(found, len(found), side, *_OF_MOTION, motion, off)
    return motion, off


def verified(
    query: PackedRegions, references: Sequence[PackedRegions], starts: Sequence[tuple[int, int]]
) -> Doubles:
    """Return `numpy_kernels.verified`."""
    results = np.empty((len(references), 9))
    addresses = np.array([address(reference.rows) for reference in references], np.uint64)
    shifts, count = np.array(starts, np.int64).reshape(-1, 2), len(references)
    _verify(
        query.rows, addresses, count, query.side, shifts, *_OF_FIELD, *_OF_MOTION, results
    )  # fmt: skip
    return results
