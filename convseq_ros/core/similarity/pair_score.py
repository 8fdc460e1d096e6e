# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a way to score a pair of images consists of."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from convseq_ros.core.encoding.regions import Cells, Regions
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

# In [0, 1], (n,), and shifts in cells, rows and columns, (n, 2), if the kernel tells.
Scores = tuple[npt.NDArray[np.float32], npt.NDArray[np.float64] | None]
# (N, 32), and their blocks, None without a background.
ShowRegions = Callable[[Cells, Regions | None], tuple[Regions, Any]]


@dataclass(frozen=True, slots=True)
class PairScore:
    """The functions of one kernel; another kernel replaces all of them together."""

    name: str  # of the kernel
    exact: bool  # whether scores are those of the definition, to 1e-6
    # From a query, the bits of entropy that make a region salient and the drive's background to
    # what is compared of it; None if it shows nothing.
    extract: Callable[[Descriptor, float, Regions | None], Any]
    # From a reference's cells and the map's background to what is compared of it.
    prepare: Callable[[Cells, Regions | None], Any]
    # From a query and n references to their scores and shifts.
    compare: Callable[[Any, Sequence[Any]], Scores]
    # From cells and a background to the regions that are compared, and their blocks; from cells to
    # normalised ones. Only where a background can be subtracted.
    regions: ShowRegions | None = None
    normalize: Callable[[Cells], Cells] | None = None
