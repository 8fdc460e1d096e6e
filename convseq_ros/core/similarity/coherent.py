# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Coherent matching, ours: the share of regions that moved together from query to reference.

At the true place the regions of the query are found again with one common shift; elsewhere,
however similar the best counterparts are, their shifts scatter. So where each counterpart lies is
asked, not how similar it is, which survives night, seasons and another viewpoint.
"""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from threading import local

from convseq_ros.core.encoding.unit import unit
from convseq_ros.core.types import Descriptor, Shift
import cv2
import numpy as np
import numpy.typing as npt

SIGMA_CELLS = 1.5
_SPAN = 3
REACH = 6

Regions = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class CoherentQuery:
    """
    What is compared of a query.

    Parameters
    ----------
    regions : ndarray of float32, shape (G, 32)
        Its salient regions, from `projected_regions`.
    index : ndarray of int64, shape (G,)
        Where they lie, row by row.
    side : int
        Regions in a row of the image.

    """

    regions: Regions
    index: npt.NDArray[np.int64]
    side: int


@cache
def projection() -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return the fixed mean (72,) and projection (72, 32); projection.md says where from."""
    with files('convseq_ros.core.encoding').joinpath('projection.npy').open('rb') as file:
        stored = np.load(file, allow_pickle=False)
    return stored[:, 0], stored[:, 1:]


def joined_regions(cells: npt.NDArray[np.float32]) -> Regions:
    """Return the 3 x 3-cell regions of an image at stride one, unit rows of shape (N, 72)."""
    side, bins = cells.shape[0] - _SPAN + 1, cells.shape[2]
    cells = np.ascontiguousarray(cells)
    rows, columns, one = cells.strides
    # In memory, the cells of a region that lie side by side are one run of numbers.
    joined = np.lib.stride_tricks.as_strided(
        cells, (side, side, _SPAN, _SPAN * bins), (rows, columns, rows, one), writeable=False
    )
    return unit(joined.reshape(side * side, -1))


def projected_regions(cells: npt.NDArray[np.float32]) -> Regions:
    """
    Return the 3 x 3-cell regions of an image, projected.

    Parameters
    ----------
    cells : ndarray of float32, shape (S, S, 8)
        Cell histograms.

    Returns
    -------
    ndarray of float32, shape ((S - 2) ** 2, 32)
        Row by row over the image, each of unit length.

    """
    mean, axes = projection()
    return unit((joined_regions(cells) - mean) @ axes)


def see(
    query: Descriptor, least_bits: float, regions: Regions | None = None
) -> CoherentQuery | None:
    """
    Return what is compared of a query; None if no region of it is salient.

    Parameters
    ----------
    query : Descriptor
        Of any image.
    least_bits : float
        Mean entropy over its 3 x 3 cells that makes a region salient.
    regions : ndarray of float32, shape (N, 32), optional
        All of its regions; its `projected_regions` by default.

    """
    entropy = cv2.boxFilter(query.cell_entropy, -1, (_SPAN, _SPAN))[1:-1, 1:-1]
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

    Parameters
    ----------
    query : CoherentQuery
        With at least one region.
    reference : ndarray of float32, shape (N, 32)
        From `projected_regions`.

    Returns
    -------
    score : float
        In [0, 1].
    shift : (float, float)
        Rows and columns, in cells, from the query's regions to the reference's; positive columns:
        things are further right in the reference.

    """
    similarity = np.dot(query.regions, reference.T, out=_scratch(query, reference))
    there, back = similarity.argmax(axis=1), _first_rows(similarity)
    everywhere = np.arange(len(reference))
    votes = _votes(query.index, there, query.side)
    votes += _votes(query.index[back], everywhere, query.side) * (len(there) / len(back))
    peak = cv2.sepFilter2D(votes, -1, WINDOW, WINDOW, borderType=cv2.BORDER_CONSTANT)
    place = int(peak.argmax())
    row, column = divmod(place, peak.shape[1])
    score = float(peak.flat[place]) / (2 * len(there))
    return min(score, 1.0), (float(row - query.side + 1), float(column - query.side + 1))


def agreeing_regions(
    query: CoherentQuery, reference: Regions, shift: Shift
) -> npt.NDArray[np.float64]:
    """
    Return which regions moved by a shift: what a person may look at.

    Parameters
    ----------
    query : CoherentQuery
        With at least one region.
    reference : ndarray of float32, shape (N, 32)
        From `projected_regions`.
    shift : (float, float)
        Rows and columns, in cells.

    Returns
    -------
    ndarray of float64, shape (n, 4)
        Middle of each region in the query (row, column) and of its counterpart in the reference,
        as shares of the image's height and width.

    """
    counterpart = (query.regions @ reference.T).argmax(axis=1)
    start = np.column_stack(np.divmod(query.index, query.side))
    end = np.column_stack(np.divmod(counterpart, query.side))
    agreeing = np.hypot(*(end - start - shift).T) <= SIGMA_CELLS
    middles = np.hstack((start, end))[agreeing] + _SPAN / 2
    return middles / (query.side + _SPAN - 1)


WINDOW = np.exp(-(np.arange(-REACH, REACH + 1) ** 2) / (2 * SIGMA_CELLS**2))
_memory = local()


def _scratch(query: CoherentQuery, reference: Regions) -> npt.NDArray[np.float32]:
    """Return room for all similarities; memory that is new for every pair costs a third."""
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
