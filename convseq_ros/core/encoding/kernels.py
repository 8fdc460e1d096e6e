# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The inner loops of an image's encoding in C (kernels.c), defined by `numpy_kernels`."""

from functools import cache

from convseq_ros.core.compiled import Array, INT, kernel, SIZE
from convseq_ros.core.encoding.regions import Cells, projection, Regions, regions_in_a_row
from convseq_ros.core.types import Doubles, Floats, Gray, Indices
import numpy as np
import numpy.typing as npt

_disk_sums = kernel(
    'disk_sums', Array('u2'), Array('i8'), SIZE, Array('f8'), SIZE, SIZE, Array('f8')
)
_histograms = kernel('histograms', Array('u1'), SIZE, Array('f8'), Array('f4'))
_project = kernel('project', Array('f4'), SIZE, INT, Array('f4'), Array('f4'), Array('f4'))


def disk_sums(
    levels: npt.NDArray[np.uint16], half_widths: Indices, terms: Doubles, sums: Doubles
) -> None:
    """Fill in the sum of `terms` by each level's count in a disk around every pixel."""
    _disk_sums(levels, half_widths, half_widths.size, terms, *sums.shape, sums)


def histograms(framed: Gray, gamma: Doubles, cells: Cells) -> None:
    """Fill in the cells (S, S, 8) of an image (16 S + 4, 16 S + 4); `gamma` is by grey level."""
    _histograms(framed, len(framed) - 4, gamma, cells)


def project(cells: Cells, step: int = 1) -> Regions:
    """Return `projected_regions`, to 1e-6; `step` is 1 or 2."""
    cells, (projected, origin) = np.ascontiguousarray(cells), axes()
    regions = np.empty((regions_in_a_row(len(cells), step) ** 2, len(origin)), np.float32)
    _project(cells, len(cells), step, projected, origin, regions)
    return regions


@cache
def axes() -> tuple[Floats, Floats]:
    """Return the axes and the projected mean, in float64 sums so that all processors agree."""
    mean, projected = projection()
    origin = mean.astype(np.float64) @ projected.astype(np.float64)
    return np.ascontiguousarray(projected), origin.astype(np.float32)
