# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Displacements and motions by NumPy and OpenCV: the definition, and the fallback."""

from collections.abc import Sequence
from functools import lru_cache

from convseq_ros.core.encoding.regions import Regions
from convseq_ros.core.geometry.verification import (
    Displacements,
    FIELD,
    initial_motion,
    Motion,
    MOTION_FIT,
    PackedRegions,
    weights,
)
from convseq_ros.core.types import Doubles, Flags, Floats
import cv2
import numpy as np
import numpy.typing as npt

Volume = Floats  # (side * side, span * span), similarities by place and displacement; or -inf
_WEIGHTS = weights()
_SPAN = 2 * FIELD.reach_cells + 1
_NORMS_KEPT = 16  # of the last common shifts, 370 kB each


def arrange(regions: Regions, rows: npt.NDArray[np.int32]) -> None:
    """Lay out regions (side ** 2, 32) as bytes in words (side, 8, wide); NaN becomes 0."""
    side = len(rows)
    scaled = np.where(np.isfinite(regions), regions, 0) * np.float32(FIELD.scale)
    words = np.clip(np.rint(scaled), -127, 127).astype(np.int8).view(np.int32)
    rows[:, :, :side] = words.reshape(side, side, -1).transpose(0, 2, 1)


def displacements(
    query: PackedRegions, reference: PackedRegions, start: tuple[int, int]
) -> Displacements:
    """
    Return the regions of a query that are points in a reference and back, (n, 5).

    All displacements within 4 cells of `start` are compared by similarity, averaged over
    neighbours. The best one is refined by parabolas. It is kept if it is not on the border of the
    search and the best displacement back from there differs by at most 0.7 cells.
    """
    side, shape = query.side, (query.side**2, _SPAN**2)
    sums, (norms, shared) = _blended(_tried(query, reference, start)), _norms(side, start)
    means = sums / norms + shared
    volume, back = means.reshape(shape), _turned(means, start).reshape(shape)
    ahead, best, known = _refined(volume, start)
    place = np.flatnonzero(known)
    points = np.array(np.divmod(place, side), np.float32)
    row, column = np.floor(points + ahead[:, place] + np.float32(0.5)).astype(int)
    inside = (row >= 0) & (row < side) & (column >= 0) & (column < side)
    place, there = place[inside], (row * side + column)[inside]
    behind, _, found_back = _refined(back[there], start)
    miss = ((ahead[:, place] - behind) ** 2).sum(axis=0)
    place = place[found_back & (miss <= np.float32(FIELD.tolerance_cells) ** 2)]
    return np.column_stack((*np.divmod(place, side), *ahead[:, place], best[place])).astype(
        np.float32
    )


def fit_motion(found: Displacements, side: int, start: tuple[int, int]) -> Motion:
    """
    Return the common affine motion (2, 3) of displacements, and the errors (n,) in cells.

    It starts as the shift `start` and is fitted 8 times, by weighted least squares: an error of s
    cells has the weight 1 / (1 + (s / 2)^2)^2.
    """
    middle, sigma = (side - 1) / 2, MOTION_FIT.sigma_cells
    places, moved = np.ones((3, len(found))), np.array(found[:, 2:4].T, np.float64)
    places[1:] = (found[:, :2].T.astype(np.float64) - middle) / side
    motion = initial_motion(start)
    stiff = np.diag([1e-6, MOTION_FIT.stiffness, MOTION_FIT.stiffness])
    for _ in range(MOTION_FIT.rounds):
        off_squared = ((moved - motion @ places) ** 2).sum(axis=0)
        weighted = places / (1 + off_squared / sigma**2) ** 2
        motion = np.linalg.solve(weighted @ places.T + stiff, weighted @ moved.T).T
    return motion, np.hypot(*(moved - motion @ places))


def verified(
    query: PackedRegions, references: Sequence[PackedRegions], starts: Sequence[tuple[int, int]]
) -> Doubles:
    """Return inliers, strength, its upper half, and the motion, of n references: (n, 9)."""
    results = np.empty((len(references), 9))
    for row, reference, start in zip(results, references, starts, strict=True):
        found = displacements(query, reference, start)
        motion, off = fit_motion(found, query.side, start)
        each = found[:, 4] / (1 + (off / MOTION_FIT.sigma_cells) ** 2)
        is_upper = found[:, 0] < query.side / 2
        row[0] = (off <= MOTION_FIT.sigma_cells).sum()
        row[1:3] = max(0.0, each.sum()), max(0.0, each[is_upper].sum())
        row[3:] = motion.ravel()
    return results


def _moved(images: Floats, start: Sequence[int], fill: float) -> Floats:
    """Return images (side, side, ...), shifted and padded to the reach of the search."""
    side, wide = len(images), len(images) + _SPAN - 1
    moved = np.full((wide, wide, *images.shape[2:]), fill, np.float32)
    targets, sources = [], []
    for by in start:
        first = max(0, -by)
        end = max(first, min(wide, side - by))
        targets.append(slice(first, end))
        sources.append(slice(first + by, end + by))
    moved[*targets] = images[*sources]
    return moved


def _tried(query: PackedRegions, reference: PackedRegions, start: tuple[int, int]) -> Floats:
    """Return similarities (side, side, span, span) by place and displacement; 0 if outside."""
    side = query.side
    image, other = (each.regions.reshape(side, side, -1) for each in (query, reference))
    # The reference is shifted by the first displacement of the search and padded with zeros.
    moved = _moved(other, [middle - FIELD.reach_cells for middle in start], 0)
    tried = np.empty((side, side, _SPAN, _SPAN), np.float32)
    for i, j in np.ndindex(_SPAN, _SPAN):
        tried[:, :, i, j] = np.einsum('yxk,yxk->yx', image, moved[i : i + side, j : j + side])
    return tried


def _turned(means: Floats, start: tuple[int, int]) -> Floats:
    """Return the same similarities by the place in the reference, backwards; or -inf."""
    # The places are shifted by the last displacement of the search and padded with -inf.
    side, last = len(means), [1 - _SPAN + FIELD.reach_cells - middle for middle in start]
    moved, turned = _moved(means, last, -np.inf), np.empty_like(means)
    for i, j in np.ndindex(_SPAN, _SPAN):
        # A displacement by one more cell starts one cell earlier.
        top, left = _SPAN - 1 - i, _SPAN - 1 - j
        turned[:, :, i, j] = moved[top : top + side, left : left + side, i, j]
    return turned


@lru_cache(_NORMS_KEPT)
def _norms(side: int, start: tuple[int, int]) -> tuple[Floats, Floats]:
    """Return sums of weights, (side, side, span, span), and 0 inside the reference, else -inf."""
    away = np.arange(-FIELD.reach_cells, FIELD.reach_cells + 1)
    y, x, i, j = np.ogrid[:side, :side, :_SPAN, :_SPAN]
    row, column = y + start[0] + away[i], x + start[1] + away[j]
    shared = (row >= 0) & (row < side) & (column >= 0) & (column < side)
    sums = np.where(shared, _blended(shared.astype(np.float32)), np.float32(1))
    return sums, np.where(shared, np.float32(0), np.float32(-np.inf))


def _blended(images: Floats) -> Floats:
    """Return weighted sums over neighbouring places of images (side, side, span, span)."""
    flat = images.reshape(*images.shape[:2], -1)
    blended = cv2.sepFilter2D(flat, -1, _WEIGHTS, _WEIGHTS, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(blended, np.float32).reshape(images.shape)


def _refined(volume: Volume, start: tuple[int, int]) -> tuple[Floats, Floats, Flags]:
    """Return subcell displacements (2, n), their similarities, and whether they are valid."""
    at, places = volume.argmax(axis=1), np.arange(len(volume))
    i, j = np.divmod(at, _SPAN)
    top = volume[places, at]
    inside = np.isfinite(top) & (i > 0) & (i < _SPAN - 1) & (j > 0) & (j < _SPAN - 1)
    at = i.clip(1, _SPAN - 2) * _SPAN + j.clip(1, _SPAN - 2)
    beside = (
        _beside(volume[places, at - step], top, volume[places, at + step]) for step in (_SPAN, 1)
    )
    moved = np.add.outer(start, [-FIELD.reach_cells]) + np.array([i, j])
    return (moved + np.array([*beside])).astype(np.float32), top, inside


def _beside(before: Floats, middle: Floats, after: Floats) -> Floats:
    """Return the offset of a parabola's top from the middle; 0 where a value is not known."""
    known = np.isfinite(before) & np.isfinite(middle) & np.isfinite(after)
    with np.errstate(invalid='ignore', divide='ignore'):
        bend = before - 2 * middle + after
        off = (before - after) / 2 / bend
    return np.where(known & (bend < 0), off, np.float32(0)).clip(-0.5, 0.5)
