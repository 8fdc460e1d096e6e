# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coherent pair scores by NumPy and OpenCV: the definition, which also runs without C."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from convseq_ros.core.encoding.regions import Cells, projected_regions, REGION, Regions, unit
from convseq_ros.core.similarity.coherent import (
    Blocks,
    COHERENT,
    CoherentPair,
    CoherentQuery,
    Compared,
    Foreground,
    global_similarity,
    region_blocks,
    Wide,
)
from convseq_ros.core.types import constants, Doubles, Indices, Shift
import cv2
import numpy as np
import numpy.typing as npt

_Reference = tuple[npt.NDArray[np.int8], Blocks | None]  # regions (N, 32) and their blocks


@constants
class NORMALIZATION:
    """Chosen among 50 variants on real and darkened image pairs (docs/NOTES.md)."""

    side: float = 0.0404  # weight of a neighbour; a Gaussian of 0.4 cells
    middle: float = 1 - 2 * 0.0404  # weight of the cell itself
    saturation: float = 6.0  # number, in means of the image, that becomes 0.5


def normalized(cells: Cells) -> Cells:
    """
    Return cells (S, S, 8) without noise and with strong edges compressed, in [0, 1).

    Noise is equal in all bins of a cell, so the smallest bin is subtracted. Neighbours are
    blended, so that an edge may lie on either side of a border. With m the mean of the image, x
    becomes x / (x + 6 m); otherwise a lamp would dominate its region.
    """
    above = cells - cells.min(axis=2, keepdims=True)
    kernel = np.array([NORMALIZATION.side, NORMALIZATION.middle, NORMALIZATION.side], np.float32)
    blended = cv2.sepFilter2D(above, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
    typical = np.float32(NORMALIZATION.saturation * blended.mean(dtype=np.float64))
    return blended / (blended + typical) if typical else blended


def less_background(regions: Regions, background: Regions | None) -> Foreground:
    """Return regions (N, 32) less a background, at unit length, and their blocks."""
    if background is None:
        return regions, None
    foreground = unit(regions - background)
    return foreground, region_blocks(foreground)


def in_bytes(regions: Regions) -> npt.NDArray[np.int8]:
    """Return regions (N, 32), rounded to bytes: their products are exact in any order."""
    return np.clip(np.rint(regions * np.float32(REGION.byte_scale)), -127, 127).astype(np.int8)


def window(sigma_cells: float) -> Doubles:
    """Return the Gaussian (13,) of the votes, rounded so that all libraries agree."""
    cells = np.arange(-COHERENT.reach_cells, COHERENT.reach_cells + 1)
    return np.exp(-(cells**2) / (2 * sigma_cells**2)).astype(np.float32).astype(float)


WINDOW = window(COHERENT.sigma_cells)
WINDOWS = {1: WINDOW, COHERENT.rough_step: window(COHERENT.rough_sigma)}  # by step


def coherent_score(
    query: CoherentQuery, reference: Regions, window: Doubles = WINDOW
) -> tuple[float, Shift]:
    """
    Return the share of the regions that agree on a common shift, in [0, 1], and that shift.

    Every salient region of the query votes for the shift to its best counterpart in the
    reference (N, 32); every region of the reference votes for the shift from its best counterpart
    among the query's salient ones, with the same weight in total. Votes are summed with a
    Gaussian of 1.5 cells. The shift is rows and columns, in cells, from the query to the
    reference; positive columns: things are further right in the reference. Of equal counterparts
    the last one is taken.
    """
    # Backwards, since `argmax` returns the first of equals.
    similarity = query.regions[::-1] @ reference[::-1].T
    there = len(reference) - 1 - similarity.argmax(axis=1)[::-1]
    # Transposed first: argmax down the columns takes five times as long.
    back = len(query.regions) - 1 - cv2.transpose(similarity).argmax(axis=1)[::-1]
    votes = _votes(query.index, there, query.side)
    votes += _votes(query.index[back], slice(None), query.side) * (len(there) / len(back))
    peak = cv2.sepFilter2D(votes, -1, window, window, borderType=cv2.BORDER_CONSTANT)
    place = int(peak.argmax())
    row, column = divmod(place, peak.shape[1])
    score = float(peak.flat[place]) / (2 * len(there))
    return min(score, 1.0), (float(row - query.side + 1), float(column - query.side + 1))


def _votes(start: Indices, end: Indices | slice, side: int) -> Doubles:
    """Return how often each shift of rows and columns occurs; no shift is in the middle."""
    span, where = 2 * side - 1, _grid(side)
    counts = np.bincount(where[end] - where[start] + where[-1], minlength=span * span)
    return counts.reshape(span, span).astype(np.float64)


@cache
def _grid(side: int) -> Indices:
    """Return the positions of regions in a grid of shifts; the last one is in its middle."""
    rows = np.arange(side)
    return (rows[:, None] * (2 * side - 1) + rows).ravel()


class NumpyCoherent(CoherentPair):
    """The definition as a kernel; regions are rounded to bytes."""

    name = 'numpy'
    normalize = staticmethod(normalized)
    project = staticmethod(projected_regions)
    subtract = staticmethod(less_background)

    def laid_out(self, query: CoherentQuery) -> CoherentQuery:
        return replace(query, regions=in_bytes(query.regions).astype(np.float32))

    def packed(self, regions: Regions, blocks: Blocks | None) -> _Reference:
        return in_bytes(regions), blocks

    def regions_of(self, reference: _Reference) -> Regions:
        return reference[0] * np.float32(1 / REGION.byte_scale)

    def scores(
        self, query: CoherentQuery, wide: Wide | None, references: Sequence[_Reference]
    ) -> Compared:
        window = WINDOWS[self.step]
        scores = (coherent_score(query, it.astype(np.float32), window) for it, _ in references)
        shares, shifts = zip(*scores, strict=True)
        results = np.array(shares, np.float32), np.array(shifts)
        blocks = [of_reference for _, of_reference in references]
        if wide is None or any(of_reference is None for of_reference in blocks):
            return *results, None
        return *results, global_similarity(wide, np.array(blocks, np.float64))
