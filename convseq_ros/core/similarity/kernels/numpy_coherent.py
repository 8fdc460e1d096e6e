# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coherent pair scores by NumPy and OpenCV: the definition, and the fallback without C."""

from collections.abc import Sequence
from functools import cache
from threading import local
from typing import Any

from convseq_ros.core.encoding.regions import projected_regions, Regions, unit
from convseq_ros.core.similarity.coherent import COHERENT, coherent_pair, CoherentQuery
from convseq_ros.core.similarity.global_similarity import (
    Blocks,
    global_similarity,
    region_blocks,
    Wide,
)
from convseq_ros.core.similarity.kernels.numpy_normalization import normalized
from convseq_ros.core.similarity.pair_score import Scores, Shown
from convseq_ros.core.types import Shift
import cv2
import numpy as np
import numpy.typing as npt


def window(sigma_cells: float) -> npt.NDArray[np.float64]:
    """Return the Gaussian of the votes, 13 numbers, rounded so that all libraries agree."""
    cells = np.arange(-COHERENT.reach_cells, COHERENT.reach_cells + 1)
    return np.exp(-(cells**2) / (2 * sigma_cells**2)).astype(np.float32).astype(float)


WINDOW = window(COHERENT.sigma_cells)
WINDOWS = {1: WINDOW, COHERENT.rough_step: window(COHERENT.rough_sigma)}  # by step


def coherent_score(
    query: CoherentQuery, reference: Regions, window: npt.NDArray[np.float64] = WINDOW
) -> tuple[float, Shift]:
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
    similarity, turned = _scratch(len(query.index), len(reference))
    np.dot(query.regions, reference.T, out=similarity)
    # Turned first: an arg maximum down the columns takes five times as long.
    there, back = similarity.argmax(axis=1), cv2.transpose(similarity, turned).argmax(axis=1)
    votes = _votes(query.index, there, query.side)
    votes += _votes(query.index[back], slice(None), query.side) * (len(there) / len(back))
    peak = cv2.sepFilter2D(votes, -1, window, window, borderType=cv2.BORDER_CONSTANT)
    place = int(peak.argmax())
    row, column = divmod(place, peak.shape[1])
    score = float(peak.flat[place]) / (2 * len(there))
    return min(score, 1.0), (float(row - query.side + 1), float(column - query.side + 1))


def subtracted(regions: Regions, background: Regions | None) -> Regions:
    """Return regions (N, 32) less their background, of unit length; as they are if None."""
    return regions if background is None else unit(regions - background)


def less_background(regions: Regions, background: Regions | None) -> Shown:
    """Return regions that are compared, and their blocks if there is a background."""
    shown = subtracted(regions, background)
    return shown, None if background is None else region_blocks(shown)


_memory = local()


def _scratch(rows: int, columns: int) -> tuple[Regions, Regions]:
    """Return room for similarities and for the same turned, kept since new memory takes time."""
    needed = rows * columns
    if getattr(_memory, 'numbers', np.empty((2, 0))).shape[1] < needed:
        _memory.numbers = np.empty((2, needed), np.float32)
    one, other = _memory.numbers[:, :needed]
    return one.reshape(rows, columns), other.reshape(columns, rows)


def _votes(
    start: npt.NDArray[np.int64], end: npt.NDArray[np.int64] | slice, side: int
) -> npt.NDArray[np.float64]:
    """Return how often each shift of rows and columns occurs, zero in the middle."""
    span, where = 2 * side - 1, _grid(side)
    counts = np.bincount(where[end] - where[start] + where[-1], minlength=span * span)
    return counts.reshape(span, span).astype(np.float64)


@cache
def _grid(side: int) -> npt.NDArray[np.int64]:
    """Return where regions lie in a grid of shifts, whose middle is where the last one lies."""
    rows = np.arange(side)
    return (rows[:, None] * (2 * side - 1) + rows).ravel()


def _same(what: Any) -> Any:
    return what


def _both(regions: Regions, blocks: Blocks | None) -> Shown:
    return regions, blocks


def _compare(
    query: CoherentQuery, wide: Wide | None, references: Sequence[Shown], step: int
) -> tuple[Scores, npt.NDArray[np.float32] | None]:
    told = (coherent_score(query, regions, WINDOWS[step]) for regions, _ in references)
    scores, shifts = zip(*told, strict=True)
    found, blocks = (
        (np.array(scores, np.float32), np.array(shifts)),
        [one for _, one in references],
    )
    if wide is None or any(one is None for one in blocks):
        return found, None
    return found, global_similarity(wide, np.array(blocks, np.float64))


def _regions_of(reference: Shown) -> Regions:
    return reference[0]


COHERENT_PAIR = coherent_pair(
    'numpy',
    True,
    (normalized, projected_regions, less_background),
    _same,
    (_both, _regions_of),
    _compare,
)
