# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
When a loop is closed by whole-image scores: DLoopDetector (Galvez-Lopez and Tardos, T-RO 2012).

Its defaults are kept: scores are told as shares of that with the frame before, neighbours make an
island, islands must agree for more than 3 frames, and RANSAC must find 12 inliers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

ALPHA = 0.3  # least share of the score with the frame before
CONSISTENT = 3  # frames before this one whose islands agree
_LEAST_USUAL = 0.005  # score with the frame before, below which nothing is said
_MOST_RESULTS = 50  # references that are looked at
_GAP = 3  # references between two of an island, and between islands that agree
_QUERIES_APART = 2  # frames between two that follow each other


@dataclass(frozen=True, slots=True)
class Detection:
    """The decision on a frame."""

    reference: int | None = None  # the most likely place; None if every score is too low
    inliers: int = (
        0  # keypoints that agree; 0 if islands have not agreed for long enough to verify
    )


@dataclass(frozen=True, slots=True)
class Island:
    """References in a row that a frame may show: the first, the last, the best, their score."""

    first: int
    last: int
    best: int
    score: float

    def agrees(self, other: 'Island') -> bool:
        """Return whether two overlap, or hardly lie apart."""
        return max(self.first - other.last, other.first - self.last) <= _GAP


def islands(scores: dict[int, float]) -> list[Island]:
    """Return the islands of references with these scores, in their order."""
    groups: list[list[int]] = []
    for reference in sorted(scores):
        if groups and reference - groups[-1][-1] <= _GAP:
            groups[-1].append(reference)
        else:
            groups.append([reference])
    return [
        Island(own[0], own[-1], max(own, key=scores.__getitem__), sum(scores[one] for one in own))
        for own in groups
    ]


def detect(
    rows: npt.NDArray[np.float32],
    usual: Sequence[float],
    verify: Callable[[int, int], int],
    alpha: float = ALPHA,
) -> list[Detection]:
    """
    Return the decision on each frame of a drive.

    `rows` (Q, R) are scores with the references, NaN where one may not be matched; `usual` (Q,) is
    the score of each frame with the one before. `verify` counts the keypoints of a frame and a
    reference that agree. `alpha` is the smallest share of the usual score.
    """
    found, last, agreed, last_frame = list[Detection](), None, 0, -_QUERIES_APART
    for frame, (row, common) in enumerate(zip(rows, usual, strict=True)):
        known = np.flatnonzero(np.isfinite(row))
        best = known[np.argsort(-row[known], kind='stable')][:_MOST_RESULTS].tolist()
        enough = alpha * common if common >= _LEAST_USUAL else np.inf
        scores = {one: float(row[one]) / common for one in best if row[one] >= enough}
        if not scores:
            found.append(Detection())
            continue
        island = max(islands(scores), key=lambda one: one.score)
        follows = last is not None and frame - last_frame <= _QUERIES_APART
        agreed = agreed + 1 if follows and last is not None and island.agrees(last) else 1
        last, last_frame = island, frame
        count = verify(frame, island.best) if agreed > CONSISTENT else 0
        found.append(Detection(island.best, count))
    return found
