# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How fast the query drives, compared with the reference: the slope of the diagonals."""

from collections.abc import Sequence

from convseq_ros.core.sequence import Row, sequence_scores
import numpy as np

SLOPES = (1.0, 0.5, 0.57, 0.67, 0.8, 1.25, 1.5, 1.75, 2.0)
_SHORTEST = 8
_MEMORY_FRAMES = 20
_PREFERENCE = 0.95


class SlopeSearch:
    """
    Follows the slope whose best sequence stands out most, frame after frame.

    How far the best score of a frame stands above the mean of all is averaged for every slope over
    about the last 20 frames. Another slope than 1 must stand out by a twentieth more, because a
    search that takes the best slope of every single frame finds chance alignments. A sequence of
    less than 8 frames tells no slope.
    """

    def __init__(self) -> None:
        self._prominence = np.zeros(len(SLOPES))

    def reset(self) -> None:
        """Forget the frames seen so far."""
        self._prominence[:] = 0.0

    def follow(self, rows: Sequence[Row | None]) -> float:
        """
        Take in the newest frame and return the slope, references per frame.

        Parameters
        ----------
        rows : sequence of k ndarrays of float32, shape (R,), or None
            Scores of the frames, newest first; as for `sequence_scores`.

        """
        if len(rows) >= _SHORTEST:
            now = np.array([_prominence(rows, slope) for slope in SLOPES])
            if not self._prominence.any():
                self._prominence = now
            self._prominence += (now - self._prominence) / _MEMORY_FRAMES
        weight = np.full(len(SLOPES), _PREFERENCE)
        weight[0] = 1.0
        return SLOPES[int((weight * self._prominence).argmax())]


def _prominence(rows: Sequence[Row | None], slope: float) -> float:
    scores = sequence_scores(rows, slope=slope)
    scores = scores[np.isfinite(scores)]
    return float(scores.max() - scores.mean()) if scores.size else 0.0
