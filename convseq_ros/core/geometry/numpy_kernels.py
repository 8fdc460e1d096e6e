# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Displacements and their motion by NumPy and OpenCV: the definition, and the fallback."""

from collections.abc import Sequence
from functools import lru_cache

from convseq_ros.core.encoding.regions import REGION
from convseq_ros.core.geometry.displacement import Arranged, Displacements, FIELD, weights
from convseq_ros.core.geometry.motion import initial_motion, MOTION, Motion
import cv2
import numpy as np
import numpy.typing as npt

Volume = npt.NDArray[np.float32]  # (span, span, side, side), by displacement and place; or -inf
_WEIGHTS = weights()
_SPAN = 2 * FIELD.reach_cells + 1
_NORMS_KEPT = 16  # of the last common shifts, 370 kB each


def displacements(query: Arranged, reference: Arranged, start: tuple[int, int]) -> Displacements:
    """
    Return which regions of a query are found in a reference, and found back, (n, 5).

    Every displacement within 4 cells of `start`, rows and columns, is tried for all regions; its
    similarities are averaged over neighbours, since these move alike and know together what none
    knows alone. The best displacement of a region, refined by a parabola in both directions,
    counts if it is not on the border of the search, and the best of where it leads to, seen from
    the reference, differs by at most 0.7 cells. Query and reference are of one size.
    """
    side, away = query.side, range(-FIELD.reach_cells, FIELD.reach_cells + 1)
    sums, (shared, norms) = _blended(_tried(query, reference, start)), _norms(side, start)
    means = np.divide(sums, norms, out=np.full_like(sums, -np.inf), where=shared)
    volume = np.ascontiguousarray(means.transpose(2, 3, 0, 1))
    back = np.full_like(volume, -np.inf)  # by the place in the reference
    both = [[_overlap(side, side, middle + step) for step in away] for middle in start]
    for down, (rows, moved_rows) in enumerate(both[0]):
        for right, (columns, moved_columns) in enumerate(both[1]):
            back[down, right, moved_rows, moved_columns] = volume[down, right, rows, columns]
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
    places, moved = np.ones((3, len(found))), np.array(found[:, 2:4].T, np.float64)
    places[1:] = (found[:, :2].T.astype(np.float64) - middle) / side
    motion = initial_motion(start)
    stiff = np.diag([1e-6, MOTION.stiffness, MOTION.stiffness])
    for _ in range(MOTION.rounds):
        off = np.hypot(*(moved - motion @ places))
        weighted = places / (1 + (off / sigma) ** 2) ** 2
        motion = np.linalg.solve(weighted @ places.T + stiff, weighted @ moved.T).T
    return motion, np.hypot(*(moved - motion @ places))


def verified(
    query: Arranged, references: Sequence[Arranged], starts: Sequence[tuple[int, int]]
) -> npt.NDArray[np.float64]:
    """
    Return inliers, strength, and what the upper and the left half add to it, (n, 4).

    As `Verification` has them, of a query and n references, given their common shifts.
    """
    judged = np.empty((len(references), 4))
    for row, reference, start in zip(judged, references, starts, strict=True):
        found = displacements(query, reference, start)
        off = fit_motion(found, query.side, start)[1]
        each = found[:, 4] / (1 + (off / MOTION.sigma_cells) ** 2)
        above, beside = (found[:, axis] < query.side / 2 for axis in (0, 1))
        row[0] = (off <= MOTION.sigma_cells).sum()
        row[1:] = [max(0.0, each[some].sum()) for some in (slice(None), above, beside)]
    return judged


def _overlap(count: int, others: int, moved: int) -> tuple[slice, slice]:
    """Return which of some rows meet one of others, so far away, and which ones they meet."""
    first = max(0, -moved)
    end = max(first, min(count, others - moved))
    return slice(first, end), slice(first + moved, end + moved)


def _tried(
    query: Arranged, reference: Arranged, start: tuple[int, int]
) -> npt.NDArray[np.float32]:
    """Return similarities (side, side, span, span) by place and displacement; 0 if not shared."""
    # The reference, moved by the first displacement that is tried, among zeros.
    side, wide = query.side, query.side + _SPAN - 1
    moved = np.zeros((wide, wide, REGION.numbers), np.float32)
    (rows, own_rows), (columns, own_columns) = (
        _overlap(wide, side, middle - FIELD.reach_cells) for middle in start
    )
    image = reference.regions.reshape(side, side, -1)
    moved[rows, columns] = image[own_rows, own_columns]
    # Of each row of the query all rows that it may meet.
    shape = side, _SPAN * wide, REGION.numbers
    bands = np.lib.stride_tricks.as_strided(moved, shape, moved.strides)
    dots = query.regions.reshape(side, side, -1) @ bands.transpose(0, 2, 1)
    steps = dots.reshape(side, side, _SPAN, wide).strides
    # The farther right in a row, the farther right what it meets.
    strides = steps[0], steps[1] + steps[3], steps[2], steps[3]
    return np.lib.stride_tricks.as_strided(dots, (side, side, _SPAN, _SPAN), strides)


@lru_cache(_NORMS_KEPT)
def _norms(
    side: int, start: tuple[int, int]
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float32]]:
    """Return which places and displacements both images share, and the sums of their weights."""
    away = np.arange(-FIELD.reach_cells, FIELD.reach_cells + 1)
    y, x, i, j = np.ogrid[:side, :side, :_SPAN, :_SPAN]
    row, column = y + start[0] + away[i], x + start[1] + away[j]
    shared = (row >= 0) & (row < side) & (column >= 0) & (column < side)
    return shared, _blended(shared.astype(np.float32))


def _blended(images: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return weighted sums of neighbours in images (side, side, span, span), side by side."""
    flat = images.reshape(*images.shape[:2], -1)
    blended = cv2.sepFilter2D(flat, -1, _WEIGHTS, _WEIGHTS, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(blended, np.float32).reshape(images.shape)


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
