# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How fast the query drives, compared with the reference: the slope of the diagonals."""

from collections.abc import Callable, Sequence

from convseq_ros.core.sequence import diagonal, Row, sequence_scores
import numpy as np
import numpy.typing as npt

SLOPES = (1.0, 0.5, 0.57, 0.67, 0.8, 1.25, 1.5, 1.75, 2.0)
_SHORTEST = 8
_FEWEST_SEQUENCES = 20
_MEMORY_FRAMES = 20
_CLOSE_MEMORY_FRAMES = 10
_PREFERENCE = 0.95

Scores = npt.NDArray[np.floating]


class SlopeSearch:
    """
    Follows the slope whose best sequence stands out most, frame after frame.

    How far the best score of a frame stands above the mean of all is averaged for every slope over
    about the last 20 frames. Another slope than 1 must stand out by a twentieth more, because a
    search that takes the best slope of every single frame finds chance alignments. A sequence of
    less than 8 frames tells no slope, nor does a map in which less than 20 sequences find room.
    """

    def __init__(self) -> None:
        self._prominence: npt.NDArray[np.float64] = np.zeros(len(SLOPES))
        self._closely: dict[float, float] = {}

    def reset(self) -> None:
        """Forget the frames seen so far."""
        self._prominence[:] = 0.0
        self._closely.clear()

    def follow(
        self,
        rows: Sequence[Row | None],
        closer: Callable[[float], Scores] | None = None,
    ) -> float:
        """
        Take in the newest frame and return the slope, references per frame.

        Parameters
        ----------
        rows : sequence of k ndarrays of float32, shape (R,), or None
            Scores of the frames, newest first; as for `sequence_scores`.
        closer : callable, optional
            Where rows are a first sight only: from a slope to better scores of its likeliest
            sequences. Another slope than 1 must stand out in these, too.

        """
        if len(rows) >= _SHORTEST:
            even = _finite(rows, 1.0)
            if len(even) >= _FEWEST_SEQUENCES:
                others = [_prominence(_finite(rows, slope)) for slope in SLOPES[1:]]
                self._learn(np.array([_prominence(even), *others]))
        weight = np.full(len(SLOPES), _PREFERENCE)
        weight[0] = 1.0
        slope = SLOPES[int((weight * self._prominence).argmax())]
        if slope == 1.0 or closer is None:
            self._closely.clear()
            return slope
        for one in (1.0, slope):
            scores = closer(one)
            now = _prominence(scores[np.isfinite(scores)])
            before = self._closely.get(one, now)
            self._closely[one] = before + (now - before) / _CLOSE_MEMORY_FRAMES
        return slope if _PREFERENCE * self._closely[slope] > self._closely[1.0] else 1.0

    def _learn(self, now: npt.NDArray[np.float64]) -> None:
        if not self._prominence.any():
            self._prominence = now
        self._prominence += (now - self._prominence) / _MEMORY_FRAMES


def _finite(rows: Sequence[Row | None], slope: float) -> Scores:
    scores = sequence_scores(rows, slope=slope, dtype=np.float32)
    scores = scores[diagonal(len(rows), slope)[-1] :]
    return scores if np.isfinite(scores).all() else scores[np.isfinite(scores)]


def _prominence(scores: Scores) -> float:
    return float(scores.max() - scores.mean()) if scores.size else 0.0
