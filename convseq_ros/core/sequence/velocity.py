# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How fast the query drives, compared with the reference: the slope of the diagonals."""

from collections.abc import Callable, Sequence

from convseq_ros.core.sequence.diagonals import diagonal, Row, sequence_scores
import numpy as np
import numpy.typing as npt

SLOPES = (1.0, 0.5, 0.57, 0.67, 0.8, 1.25, 1.5, 1.75, 2.0)
_SHORTEST = 8
_FEWEST_SEQUENCES = 20
_MEMORY_FRAMES = 20
_CLOSE_MEMORY_FRAMES = 10
_POWER = 3
_PREFERENCE = 0.95**_POWER

Scores = npt.NDArray[np.floating]


class SlopeSearch:
    """
    Follows the slope whose best sequence stands out most, frame after frame.

    How far the best score of a frame stands above the mean of all is averaged for every slope over
    about the last 20 frames: its cube, so that the frames that know their place outvote at once
    those of streets that are in no map, at which every slope stands out by chance. Another slope
    than 1 must stand out by a twentieth more, because a search that takes the best slope of every
    single frame finds chance alignments. A sequence of less than 8 frames tells no slope, nor does
    a map in which less than 20 sequences find room.
    """

    def __init__(self) -> None:
        self._prominence: npt.NDArray[np.float64] = np.zeros(len(SLOPES))
        self._closely: dict[float, float] = {}
        self._room: Scores = np.zeros(0, np.float32)

    def reset(self) -> None:
        """Forget the frames seen so far."""
        self._prominence[:] = 0.0
        self._closely.clear()

    def follow(
        self, rows: Sequence[Row | None], closer: Callable[[float], Scores] | None = None
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
            even = self._known(rows, 1.0)
            if len(even) >= _FEWEST_SEQUENCES:
                of_even = _prominence(even)
                others = [_prominence(self._known(rows, slope)) for slope in SLOPES[1:]]
                self._learn(np.array([of_even, *others]))
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

    def _known(self, rows: Sequence[Row | None], slope: float) -> Scores:
        """Return the scores of all sequences that have one, until asked again."""
        steps = diagonal(len(rows), slope)
        shown = [(row, step) for row, step in zip(rows, steps, strict=True) if row is not None]
        count = max((len(row) for row, _ in shown), default=0)
        if len(self._room) < count:
            self._room = np.empty(count, np.float32)
        total = self._room[: max(0, count - steps[-1])]
        if len(total) and all(len(row) - steps[-1] + step >= len(total) for row, step in shown):
            total[:] = 0
            for row, step in shown:
                start = steps[-1] - step
                total += row[start : start + len(total)]
            # The rule, where it says the same as the sum and that in a third of the time.
            if 2 * len(shown) >= len(rows) and np.isfinite(total.max()):
                total /= len(shown)
                return total
        scores = sequence_scores(rows, slope=slope, dtype=np.float32)[steps[-1] :]
        return scores[np.isfinite(scores)]


def _prominence(scores: Scores) -> float:
    return float(scores.max() - scores.mean()) ** _POWER if scores.size else 0.0
