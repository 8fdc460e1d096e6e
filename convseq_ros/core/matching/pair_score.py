# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a way to score a pair of images consists of."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from convseq_ros.core.types import Descriptor, Shift
import numpy as np
import numpy.typing as npt

Regions = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class PairScore:
    """
    Three functions; a faster one may stand in for each.

    Parameters
    ----------
    see : callable
        From a query's descriptor, and the bits of entropy that make a region salient, to what is
        compared of it; None if it shows nothing.
    prepare : callable
        From a reference's cells to its regions.
    compare : callable
        From both to a score in [0, 1] and, if it tells, the shift in cells.
    agree : callable, optional
        From both and a shift to the regions that moved by it, (n, 4): where they are in the query
        and in the reference, row and column as shares of the image.

    """

    see: Callable[[Descriptor, float], Any]
    prepare: Callable[[npt.NDArray[np.float32]], Regions]
    compare: Callable[[Any, Regions], tuple[float, Shift | None]]
    agree: Callable[[Any, Regions, Shift], npt.NDArray[np.float64]] | None = None
