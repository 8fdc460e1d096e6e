# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Coherent matching, ours: the share of regions that moved together from query to reference.

At the true place the regions of the query are found again with one common shift; elsewhere,
however similar the best counterparts are, their shifts scatter. So where each counterpart lies is
asked, not how similar it is, which survives night, seasons and another viewpoint.
"""

from dataclasses import dataclass
from threading import local

from convseq_ros.core.encoding.regions import projected_regions, REGION, Regions
from convseq_ros.core.types import Descriptor, Shift
import cv2
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class CoherentConstants:
    """Of the votes for a shift; chosen on real image pairs (docs/MATCHING.md)."""

    sigma_cells: float = 1.5  # of the Gaussian within which votes are counted together
    reach_cells: int = 6  # where the Gaussian ends, four sigmas from its middle

    @property
    def window(self) -> npt.NDArray[np.float64]:
        """The Gaussian, 13 numbers."""
        cells = np.arange(-self.reach_cells, self.reach_cells + 1)
        return np.exp(-(cells**2) / (2 * self.sigma_cells**2))


COHERENT = CoherentConstants()
_WINDOW = COHERENT.window


@dataclass(frozen=True, slots=True)
class CoherentQuery:
    """What is compared of a query: its G salient regions."""

    regions: Regions  # (G, 32), from `projected_regions`
    index: npt.NDArray[np.int64]  # (G,), where they lie, row by row
    side: int  # regions in a row of the image


def extract(
    query: Descriptor, least_bits: float, regions: Regions | None = None
) -> CoherentQuery | None:
    """
    Return what is compared of a query; None if no region of it is salient.

    A region is, if the mean entropy over its 3 x 3 cells is at least so many bits. `regions` are
    all regions of the query, (N, 32); its `projected_regions` by default.
    """
    entropy = cv2.boxFilter(query.cell_entropy, -1, (REGION.span, REGION.span))[1:-1, 1:-1]
    index = np.flatnonzero(entropy >= least_bits)
    if not index.size or not query.cells.any():
        return None
    if regions is None:
        regions = projected_regions(query.cells)
    return CoherentQuery(regions[index], index, len(entropy))


def coherent_score(query: CoherentQuery, reference: Regions) -> tuple[float, Shift]:
    """
    Return which share of the regions agrees on one shift, and that shift.

    Every salient region of the query votes for the shift to its best counterpart in the
    reference; every region of the reference votes for the shift from its best counterpart among
    the query's salient ones, with the same weight in total. Votes are counted within a Gaussian
    of 1.5 cells.

    Returns
    -------
    score : float
        In [0, 1].
    shift : (float, float)
        Rows and columns, in cells, from the query's regions to the reference's (N, 32); positive
        columns: things are further right in the reference.

    """
    similarity = np.dot(query.regions, reference.T, out=_scratch(query, reference))
    there, back = similarity.argmax(axis=1), _first_rows(similarity)
    everywhere = np.arange(len(reference))
    votes = _votes(query.index, there, query.side)
    votes += _votes(query.index[back], everywhere, query.side) * (len(there) / len(back))
    peak = cv2.sepFilter2D(votes, -1, _WINDOW, _WINDOW, borderType=cv2.BORDER_CONSTANT)
    place = int(peak.argmax())
    row, column = divmod(place, peak.shape[1])
    score = float(peak.flat[place]) / (2 * len(there))
    return min(score, 1.0), (float(row - query.side + 1), float(column - query.side + 1))


def inlier_regions(
    query: CoherentQuery, reference: Regions, shift: Shift
) -> npt.NDArray[np.float64]:
    """
    Return which regions moved by a shift, in cells, from a query to a reference's regions.

    Of shape (n, 4): middle of each region in the query (row, column) and of its counterpart in the
    reference, as shares of the image's height and width.
    """
    counterpart = (query.regions @ reference.T).argmax(axis=1)
    start = np.column_stack(np.divmod(query.index, query.side))
    end = np.column_stack(np.divmod(counterpart, query.side))
    inliers = np.hypot(*(end - start - shift).T) <= COHERENT.sigma_cells
    middles = np.hstack((start, end))[inliers] + REGION.span / 2
    return middles / (query.side + REGION.span - 1)


_memory = local()


def _scratch(query: CoherentQuery, reference: Regions) -> npt.NDArray[np.float32]:
    """Return room for all similarities, a thread's own; new memory would cost a third."""
    needed = query.side**2 * len(reference)
    if getattr(_memory, 'numbers', np.empty(0)).size < needed:
        _memory.numbers = np.empty(needed, np.float32)
    shape = len(query.index), len(reference)
    return _memory.numbers[: shape[0] * shape[1]].reshape(shape)


def _first_rows(similarity: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
    """Return `similarity.argmax(axis=0)`, but not down the columns one by one."""
    count = similarity.shape[1]
    rows, columns = np.divmod(np.flatnonzero(similarity == similarity.max(axis=0)), count)
    first = np.empty(count, np.int64)
    first[columns[::-1]] = rows[::-1]
    return first


def _votes(
    start: npt.NDArray[np.int64], end: npt.NDArray[np.int64], side: int
) -> npt.NDArray[np.float64]:
    """Return how often each shift of rows and columns occurs, zero in the middle."""
    span = 2 * side - 1
    rows = end // side - start // side + side - 1
    columns = end % side - start % side + side - 1
    counts = np.bincount(rows * span + columns, minlength=span * span)
    return counts.reshape(span, span).astype(np.float64)
