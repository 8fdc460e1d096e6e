# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a way to score a pair of images consists of."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from convseq_ros.core.encoding.regions import Cells, Regions
from convseq_ros.core.types import Descriptor, Shift
import numpy as np
import numpy.typing as npt

Scores = tuple[npt.NDArray[np.float32], npt.NDArray[np.float64] | None]
ShowRegions = Callable[[Cells, Regions | None], tuple[Regions, Any]]


@dataclass(frozen=True, slots=True)
class PairScore:
    """
    The functions of one kernel; another kernel replaces all of them together.

    Parameters
    ----------
    name, exact : str, bool
        Of the kernel; whether scores are those of the definition, to 1e-6.
    extract : callable
        From a query's descriptor, the bits of entropy that make a region salient and the drive's
        background to what is compared of it; None if it shows nothing.
    prepare : callable
        From a reference's cells and the map's background to what is compared of it.
    compare : callable
        From a query and n references to their scores in [0, 1], float32 (n,), and to the shifts in
        cells, rows and columns, (n, 2), if it tells.
    regions, normalize : callable, optional
        From cells and a background to the regions that are compared, (N, 32), and their blocks;
        from cells to normalised ones. Only where a background can be subtracted.
    inliers : callable, optional
        From a query, a reference's regions and a shift to the regions that moved by it, (n, 4):
        row and column in the query and in the reference, as shares of the image.

    """

    name: str
    exact: bool
    extract: Callable[[Descriptor, float, Regions | None], Any]
    prepare: Callable[[Cells, Regions | None], Any]
    compare: Callable[[Any, Sequence[Any]], Scores]
    regions: ShowRegions | None = None
    normalize: Callable[[Cells], Cells] | None = None
    inliers: Callable[[Any, Regions, Shift], npt.NDArray[np.float64]] | None = None
