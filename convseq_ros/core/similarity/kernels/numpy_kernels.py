# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pair scores by NumPy and OpenCV: the definitions, and the fallback without C."""

from collections.abc import Sequence
from functools import cache
from threading import local

from convseq_ros.core.encoding.regions import (
    Cells,
    paper_regions,
    projected_regions,
    Regions,
    unit,
)
from convseq_ros.core.similarity.coherent import (
    Blocks,
    COHERENT,
    CoherentPair,
    CoherentQuery,
    Compared,
    global_similarity,
    region_blocks,
    Wide,
)
from convseq_ros.core.similarity.pair_score import PairScore, Scores, Shown, spread, SURE
from convseq_ros.core.types import constants, Descriptor, Doubles, Floats, Indices, Shift
import cv2
import numpy as np


@constants
class NORMALIZATION:
    """Chosen among 50 variants on real and darkened image pairs (docs/MATCHING.md)."""

    side: float = 0.0404  # share of a neighbour; a Gaussian of 0.4 cells
    middle: float = 1 - 2 * 0.0404  # share of the cell itself
    saturation: float = 6.0  # means of the image at which a number counts half


def normalized(cells: Cells) -> Cells:
    """
    Return cells (S, S, 8) less their noise, with strong edges made more like weak ones, in [0, 1).

    Noise is in all bins of a cell alike: the smallest is taken off. Neighbours are blended, so
    that an edge may lie on either side of a border. With m the mean of the image, x becomes x / (x
    + 6 m): else a lamp is all that a region shows.
    """
    above = cells - cells.min(axis=2, keepdims=True)
    kernel = np.array([NORMALIZATION.side, NORMALIZATION.middle, NORMALIZATION.side], np.float32)
    blended = cv2.sepFilter2D(above, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
    typical = np.float32(NORMALIZATION.saturation * blended.mean(dtype=np.float64))
    return blended / (blended + typical) if typical else blended


def less_background(regions: Regions, background: Regions | None) -> Shown:
    """Return regions (N, 32) less a background, of unit length, and their blocks, if there is."""
    if background is None:
        return regions, None
    shown = unit(regions - background)
    return shown, region_blocks(shown)


def window(sigma_cells: float) -> Doubles:
    """Return the Gaussian of the votes, 13 numbers, rounded so that all libraries agree."""
    cells = np.arange(-COHERENT.reach_cells, COHERENT.reach_cells + 1)
    return np.exp(-(cells**2) / (2 * sigma_cells**2)).astype(np.float32).astype(float)


WINDOW = window(COHERENT.sigma_cells)
WINDOWS = {1: WINDOW, COHERENT.rough_step: window(COHERENT.rough_sigma)}  # by step


def coherent_score(
    query: CoherentQuery, reference: Regions, window: Doubles = WINDOW
) -> tuple[float, Shift]:
    """
    Return which share of the regions agrees on one shift, in [0, 1], and that shift.

    Every salient region of the query votes for the shift to its best counterpart in the
    reference (N, 32); every region of the reference votes for the shift from its best counterpart
    among the query's salient ones, with the same weight in total. Votes are counted within a
    Gaussian of 1.5 cells. The shift is rows and columns, in cells, from the query to the
    reference; positive columns: things are further right in the reference.
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


_memory = local()


def _scratch(rows: int, columns: int) -> tuple[Regions, Regions]:
    """Return room for similarities and for the same turned, kept since new memory takes time."""
    needed = rows * columns
    if getattr(_memory, 'numbers', np.empty((2, 0))).shape[1] < needed:
        _memory.numbers = np.empty((2, needed), np.float32)
    one, other = _memory.numbers[:, :needed]
    return one.reshape(rows, columns), other.reshape(columns, rows)


def _votes(start: Indices, end: Indices | slice, side: int) -> Doubles:
    """Return how often each shift of rows and columns occurs, zero in the middle."""
    span, where = 2 * side - 1, _grid(side)
    counts = np.bincount(where[end] - where[start] + where[-1], minlength=span * span)
    return counts.reshape(span, span).astype(np.float64)


@cache
def _grid(side: int) -> Indices:
    """Return where regions lie in a grid of shifts, whose middle is where the last one lies."""
    rows = np.arange(side)
    return (rows[:, None] * (2 * side - 1) + rows).ravel()


class _NumpyCoherent(CoherentPair):
    normalize = staticmethod(normalized)
    project = staticmethod(projected_regions)
    subtract = staticmethod(less_background)

    def laid_out(self, query: CoherentQuery) -> CoherentQuery:
        return query

    def packed(self, regions: Regions, blocks: Blocks | None) -> Shown:
        return regions, blocks

    def regions_of(self, reference: Shown) -> Regions:
        return reference[0]

    def scores(
        self, query: CoherentQuery, wide: Wide | None, references: Sequence[Shown]
    ) -> Compared:
        told = (coherent_score(query, regions, WINDOWS[self.step]) for regions, _ in references)
        shares, shifts = zip(*told, strict=True)
        found = np.array(shares, np.float32), np.array(shifts)
        blocks = [one for _, one in references]
        if wide is None or any(one is None for one in blocks):
            return *found, None
        return *found, global_similarity(wide, np.array(blocks, np.float64))


def pair_scores(salient: Regions, references: Sequence[Regions]) -> Floats:
    """
    Return how similar a query is to each of R references, (R,), in [0, 1]; it is not symmetric.

    For every salient region of the query (G, 32) the most similar region anywhere in the reference
    (N, 32) counts, both from `paper_regions`; the score is the mean of these similarities (paper
    III-D).
    """
    scores = [min(float((salient @ one.T).max(axis=1).mean()), 1.0) for one in references]
    return np.array(scores, np.float32)


def score_beside(limit: float, salient: Regions, reference: Regions) -> float:
    """Return `pair_scores` of as many regions (G, 32) as show on which side of a limit it is."""
    found = np.zeros(0)
    for first in range(0, len(salient), SURE.regions):
        most = (salient[first : first + SURE.regions] @ reference.T).max(axis=1)
        found = np.append(found, most)
        variance = found.var() / len(found) * (1 - len(found) / len(salient))
        if (found.mean() - limit) ** 2 > SURE.errors**2 * variance:
            break
    return min(float(found.mean()), 1.0)


class _NumpyRegional(PairScore):
    name, exact = 'numpy', True

    def extract(self, query: Descriptor, _least_bits: float, _shown: object) -> Regions | None:
        return paper_regions(query.cells)[query.salient] if query.informative else None

    def prepare(self, cells: Cells, _background: object) -> Regions:
        return paper_regions(cells)

    def compare(
        self, query: Regions, references: Sequence[Regions], limit: float | None = None
    ) -> Scores:
        if limit is None:
            return pair_scores(query, references), None
        told = [score_beside(limit, spread(query), one) for one in references]
        return np.array(told, np.float32), None


DEFINITIONS = {'coherent': _NumpyCoherent('numpy', True), 'regional': _NumpyRegional()}
