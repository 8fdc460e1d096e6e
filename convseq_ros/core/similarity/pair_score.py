# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a way to score a pair of images consists of."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from convseq_ros.core.types import Descriptor, Shift
import numpy as np
import numpy.typing as npt

Cells = npt.NDArray[np.float32]
Regions = npt.NDArray[np.float32]
Scores = tuple[npt.NDArray[np.float32], npt.NDArray[np.float64] | None]


@dataclass(frozen=True, slots=True)
class Look:
    """
    What is looked at in images of which regions are compared.

    Parameters
    ----------
    even : callable
        From cells to cells in which noise and strong edges count for less; see `evened`.
    show : callable
        From cells and what is usual to the regions that are compared, (N, 32), and the image as a
        whole; none if it does not matter what is usual.
    agree : callable
        From a query, a reference's regions and a shift to the regions that moved by it, (n, 4):
        where they are in the query and in the reference, row and column as shares of the image.

    """

    even: Callable[[Cells], Cells]
    show: Callable[[Cells, Regions | None], tuple[Regions, Any]]
    agree: Callable[[Any, Regions, Shift], npt.NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class PairScore:
    """
    Functions that a faster kernel may replace, all of them together.

    Parameters
    ----------
    name : str
        Of the kernel.
    exact : bool
        Whether scores are those of the definition, to 1e-6.
    see : callable
        From a query's descriptor, the bits of entropy that make a region salient and what is usual
        in its drive to what is compared of it; None if it shows nothing.
    prepare : callable
        From a reference's cells, and what is usual in its map, to what is compared of it.
    compare : callable
        From a query and some references to their scores in [0, 1], float32 of shape (n,), and, if
        it tells, to the shifts in cells, rows and columns, (n, 2).
    look : Look, optional
        If it compares regions where they lie, of images less what is usual.

    """

    name: str
    exact: bool
    see: Callable[[Descriptor, float, Regions | None], Any]
    prepare: Callable[[Cells, Regions | None], Any]
    compare: Callable[[Any, Sequence[Any]], Scores]
    look: Look | None = None
