# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How fast the query drives, compared with the map: the slope of the diagonals."""

from collections.abc import Callable

from convseq_ros.core.constants import constants
from convseq_ros.core.sequence.diagonals import Rows, sequence_scores, Values, window_sums
import numpy as np


@constants
class VELOCITY:
    """Of the search; chosen on drawn drives and halves of real maps (docs/MATCHING.md)."""

    velocities: tuple[float, ...] = (1.0, 0.5, 0.57, 0.67, 0.8, 1.25, 1.5, 1.75, 2.0)
    shortest: int = 8  # frames of a sequence that tells a velocity
    fewest_sequences: int = 20  # that must find room in the map
    memory: int = 20  # frames over which the prominence is averaged
    close_memory: int = 10  # the same where pairs are scored
    power: int = 3  # of the prominence; frames that know their place outvote the others
    preference: float = 0.95**3  # for one to one: another velocity stands out by a twentieth more


class ConstantVelocity:
    """The query drives as fast as the map's drive did, as the paper has it."""

    def reset(self) -> None: ...

    def update(self, _rows: Rows, _closer: Callable[[float], Values] | None = None) -> float:
        return 1.0


class VelocitySearch(ConstantVelocity):
    """
    Follows the velocity whose best sequence stands out most from the mean, over 20 frames or so.

    What is averaged is a cube: frames that know their place outvote those that are in no map.
    """

    def __init__(self) -> None:
        self._room: Values = np.zeros(0, np.float32)
        self.reset()

    def reset(self) -> None:
        self._prominence: Values = np.zeros(len(VELOCITY.velocities))
        self._closely: dict[float, float] = {}

    def update(self, rows: Rows, closer: Callable[[float], Values] | None = None) -> float:
        """
        Take in rows as for `sequence_scores`; return the velocity, references per frame.

        In the better scores that `closer` leads to, one other than 1 must stand out, too.
        """
        one_to_one, *others = VELOCITY.velocities
        if len(rows) >= VELOCITY.shortest:
            even = self._known(rows, one_to_one)
            if len(even) >= VELOCITY.fewest_sequences:
                first = _prominence(even)  # before its room is used again
                now = np.array([first, *(_prominence(self._known(rows, one)) for one in others)])
                if not self._prominence.any():
                    self._prominence = now
                self._prominence += (now - self._prominence) / VELOCITY.memory
        weight = np.array([1.0, *[VELOCITY.preference] * len(others)])
        velocity = VELOCITY.velocities[int((weight * self._prominence).argmax())]
        if velocity == 1.0 or closer is None:
            self._closely.clear()
            return velocity
        for one in (1.0, velocity):
            scores = closer(one)
            close = _prominence(scores[np.isfinite(scores)])
            before = self._closely.get(one, close)
            self._closely[one] = before + (close - before) / VELOCITY.close_memory
        stands_out = VELOCITY.preference * self._closely[velocity] > self._closely[1.0]
        return velocity if stands_out else 1.0

    def _known(self, rows: Rows, velocity: float) -> Values:
        """Return the scores of all sequences that have one, until asked again."""
        if rows[0] is not None and len(self._room) < len(rows[0]):
            self._room = np.empty(len(rows[0]), np.float32)
        total = window_sums(rows, velocity, self._room)
        informative = sum(row is not None for row in rows)
        if 2 * informative >= len(rows) and len(total) and np.isfinite(total.max()):
            # All of them have a score; this takes a third of the time.
            total /= informative
            return total
        scores = sequence_scores(rows, velocity, dtype=np.float32)
        return scores[np.isfinite(scores)]


def _prominence(scores: Values) -> float:
    return float(scores.max() - scores.mean()) ** VELOCITY.power if scores.size else 0.0
