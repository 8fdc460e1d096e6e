# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Loop decision from whole-image scores: DLoopDetector (Galvez-Lopez and Tardos, T-RO 2012).

With its defaults: scores are divided by the score with the previous frame, references less than 3
apart form an island, islands must agree for more than k = 3 frames (its demo has 1), and RANSAC
needs 12 inliers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

ALPHA = 0.3  # minimum score, as a share of the score with the previous frame
CONSISTENT = 3  # required number of previous frames with agreeing islands
_LEAST_PREVIOUS = 0.005  # score with the previous frame, below which there is no detection
_MOST_RESULTS = 50  # best references per frame
_GAP = 3  # references of an island are less than this apart, islands that agree at most this
_QUERIES_APART = 2  # largest distance of consecutive frames


@dataclass(frozen=True, slots=True)
class Detection:
    """The decision on a frame."""

    reference: int | None = None  # the most likely place; None if every score is too low
    inliers: int = 0  # 0 if islands have not agreed for long enough to verify


@dataclass(frozen=True, slots=True)
class Island:
    """Consecutive references that a frame may show, with the best one and the summed score."""

    first: int
    last: int
    best: int
    score: float

    def agrees(self, other: 'Island') -> bool:
        """Return whether two islands overlap, or are at most `_GAP` apart."""
        return max(self.first - other.last, other.first - self.last) <= _GAP


def islands(scores: dict[int, float]) -> list[Island]:
    """Return the islands of references with these scores, in ascending order."""
    groups: list[list[int]] = []
    for reference in sorted(scores):
        if groups and reference - groups[-1][-1] < _GAP:
            groups[-1].append(reference)
        else:
            groups.append([reference])
    return [
        Island(run[0], run[-1], max(run, key=scores.__getitem__), sum(scores[at] for at in run))
        for run in groups
    ]


def detect(
    rows: npt.NDArray[np.float32],
    previous: Sequence[float],
    verify: Callable[[int, int], int],
    alpha: float = ALPHA,
    consistent: int = CONSISTENT,
) -> list[Detection]:
    """
    Return the decision on each frame of a drive.

    `rows` (Q, R) are scores with the references, NaN for a pair that must not match. `previous`
    (Q,) is the score of each frame with the previous one. `verify` returns the inliers of a frame
    and a reference. `alpha` is the minimum score as a share of the previous one, `consistent` the
    number of frames before that must agree.
    """
    detections, last, agreed, last_frame = list[Detection](), None, 0, -_QUERIES_APART
    for frame, (row, previous_score) in enumerate(zip(rows, previous, strict=True)):
        allowed = np.flatnonzero(np.isfinite(row))
        best = allowed[np.argsort(-row[allowed], kind='stable')][:_MOST_RESULTS].tolist()
        minimum = alpha * previous_score if previous_score >= _LEAST_PREVIOUS else np.inf
        scores = {at: float(row[at]) / previous_score for at in best if row[at] >= minimum}
        if not scores:
            detections.append(Detection())
            continue
        island = max(islands(scores), key=lambda item: item.score)
        follows = last is not None and frame - last_frame <= _QUERIES_APART
        agreed = agreed + 1 if follows and last is not None and island.agrees(last) else 1
        last, last_frame = island, frame
        count = verify(frame, island.best) if agreed > consistent else 0
        detections.append(Detection(island.best, count))
    return detections
