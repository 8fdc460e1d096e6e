# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Displacements and their motion by NumPy and OpenCV: the definition, and the fallback."""

from collections.abc import Iterator

from convseq_ros.core.geometry.displacement import Arranged, Displacements, FIELD, weights
from convseq_ros.core.geometry.motion import initial_motion, MOTION, Motion
import cv2
import numpy as np
import numpy.typing as npt

Volume = npt.NDArray[np.float32]  # (span, span, side, side), by displacement and place; or -inf
_WEIGHTS = weights()
_SPAN = 2 * FIELD.reach_cells + 1


def displacements(query: Arranged, reference: Arranged, start: tuple[int, int]) -> Displacements:
    """
    Return which regions of a query are found in a reference, and found back, (n, 5).

    Every displacement within 4 cells of `start`, rows and columns, is tried for all regions; its
    similarities are averaged over neighbours, since these move alike and know together what none
    knows alone. The best displacement of a region, refined by a parabola in both directions,
    counts if it is not on the border of the search, and the best of where it leads to, seen from
    the reference, differs by at most 0.7 cells. Query and reference are of one size.
    """
    side, volume = query.side, np.full((_SPAN, _SPAN, query.side, query.side), -np.inf, np.float32)
    back = volume.copy()  # by the place in the reference
    similarity = (query.regions @ reference.regions.T).reshape((side,) * 4)
    for i, j, here, there in _parts(side, start):
        (y, x), (row, column) = (np.ix_(*map(np.arange, *part)) for part in (here, there))
        volume[i, j, y, x] = back[i, j, row, column] = _smoothed(similarity[y, x, row, column])
    ahead, known = _refined(volume, start)
    behind, found_back = _refined(back, start)
    y, x = np.nonzero(known)
    row, column = np.floor(np.array([y, x], np.float32) + ahead[:, y, x] + np.float32(0.5)).astype(
        int
    )
    inside = (row >= 0) & (row < side) & (column >= 0) & (column < side)
    y, x, row, column = y[inside], x[inside], row[inside], column[inside]
    miss = ((ahead[:, y, x] - behind[:, row, column]) ** 2).sum(axis=0)
    kept = found_back[row, column] & (miss <= np.float32(FIELD.tolerance_cells) ** 2)
    y, x = y[kept], x[kept]
    best = volume.reshape(-1, side, side).max(axis=0)
    return np.column_stack((y, x, *ahead[:, y, x], best[y, x])).astype(np.float32)


def fit_motion(found: Displacements, side: int, start: tuple[int, int]) -> Motion:
    """
    Return the motion that displacements share, (2, 3), and how far they are off it, (n,).

    It begins as `start` and is fitted 8 times, by least squares in which what is s cells off
    counts 1 / (1 + (s / 2)^2)^2.
    """
    middle, sigma = (side - 1) / 2, MOTION.sigma_cells
    places = np.column_stack(
        (np.ones(len(found)), (found[:, :2].astype(np.float64) - middle) / side)
    )
    moved, motion = found[:, 2:4].astype(np.float64), initial_motion(start)
    stiff = np.diag([1e-6, MOTION.stiffness, MOTION.stiffness])
    for _ in range(MOTION.rounds):
        off = np.hypot(*(moved - places @ motion.T).T)
        weighted = places * (1 / (1 + (off / sigma) ** 2) ** 2)[:, None]
        motion = np.linalg.solve(weighted.T @ places + stiff, weighted.T @ moved).T
    return motion, np.hypot(*(moved - places @ motion.T).T)


Part = tuple[
    tuple[int, int], tuple[int, int]
]  # first row and column, and the ones behind the last


def _parts(side: int, start: tuple[int, int]) -> Iterator[tuple[int, int, Part, Part]]:
    """Yield displacements, and what then lies in both images: of the query, of the reference."""
    for i in range(_SPAN):
        for j in range(_SPAN):
            down, right = start[0] + i - FIELD.reach_cells, start[1] + j - FIELD.reach_cells
            first = max(0, -down), max(0, -right)
            last = min(side, side - down), min(side, side - right)
            if first[0] < last[0] and first[1] < last[1]:
                moved = (first[0] + down, first[1] + right), (last[0] + down, last[1] + right)
                yield i, j, (first, last), moved


def _smoothed(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the weighted mean of each number and its neighbours, as far as there are any."""
    sums, norms = (
        cv2.sepFilter2D(one, -1, _WEIGHTS, _WEIGHTS, borderType=cv2.BORDER_CONSTANT)
        for one in (image, np.ones_like(image))
    )
    return np.asarray(sums / norms, np.float32)


def _refined(
    volume: Volume, start: tuple[int, int]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """Return rows and columns moved, between cells, (2, side, side), and which are known."""
    i, j = np.divmod(volume.reshape(-1, *volume.shape[2:]).argmax(axis=0), _SPAN)
    y, x = np.indices(i.shape)
    top = volume[i, j, y, x]
    inside = np.isfinite(top) & (i > 0) & (i < _SPAN - 1) & (j > 0) & (j < _SPAN - 1)
    i, j = i.clip(1, _SPAN - 2), j.clip(1, _SPAN - 2)
    rows = _beside(volume[i - 1, j, y, x], top, volume[i + 1, j, y, x])
    columns = _beside(volume[i, j - 1, y, x], top, volume[i, j + 1, y, x])
    moved = np.array([start[0] - FIELD.reach_cells + i, start[1] - FIELD.reach_cells + j])
    return (moved + np.array([rows, columns])).astype(np.float32), inside


def _beside(before: Volume, middle: Volume, after: Volume) -> Volume:
    """Return how far beside the middle the top of a parabola lies; 0 where one is not known."""
    known = np.isfinite(before) & np.isfinite(middle) & np.isfinite(after)
    with np.errstate(invalid='ignore', divide='ignore'):
        bend = before - 2 * middle + after
        off = (before - after) / 2 / bend
    return np.where(known & (bend < 0), off, np.float32(0)).clip(-0.5, 0.5)
