# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How fast the query drives, compared with the map: the slope of the diagonals."""

from collections.abc import Callable
from typing import Any

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.constants import constants
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence.diagonals import diagonal, ONE_SESSION, Rows, Values
import numpy as np

Closer = Callable[[float], Values]
Peaks = Callable[[Rows, Values], Values]


@constants
class VELOCITY:
    """Of the search; chosen on drawn drives and halves of real maps (docs/MATCHING.md)."""

    # One to one, slower ones, faster ones; no further apart than a fifth or a quarter.
    velocities: tuple[float, ...] = (
        1.0, 0.08, 0.1, 0.12, 0.14, 0.17, 0.2, 0.24, 0.29, 0.34, 0.41, 0.5, 0.57, 0.67, 0.8,
        1.25, 1.5, 1.75, 2.0, 2.4, 2.9, 3.5, 4.2, 5.0, 6.0,
    )  # fmt: skip
    spacing: float = 0.25  # most between two of them, as a share
    shortest: int = 8  # frames of a sequence that tells a velocity
    fewest_sequences: int = 20  # that must find room in the map
    memory: int = 20  # frames over which the prominence is averaged
    close_memory: int = 10  # the same where pairs are scored
    power: int = 3  # of the prominence; frames that know their place outvote the others
    # For one to one, and once more for ahead: another velocity stands out by a twentieth more.
    preference: float = 0.95**3


class ConstantVelocity:
    """The query drives as fast as the map's drive did, as the paper has it."""

    def reset(self) -> None: ...

    def update(self, _rows: Rows, *_: Any, **_of: Any) -> float:
        return 1.0


class VelocitySearch(ConstantVelocity):
    """
    Follows the velocity whose best sequence stands out most from the mean, over 20 frames or so.

    What is averaged is a cube: frames that know their place outvote those that are in no map.
    In `both` directions negative ones compete: a drive that meets the places in reverse order.
    """

    def __init__(self, bounds: SessionBounds = ONE_SESSION, both: bool = False) -> None:
        self._bounds, ahead = bounds, VELOCITY.velocities
        self._velocities = (*ahead, *(-one for one in ahead)) if both else ahead
        self._weights = np.array([_weight(one) for one in self._velocities])
        self.reset()

    def reset(self) -> None:
        self._prominence: Values = np.zeros(len(self._velocities))
        self._closely: dict[float, float] = {}
        self._last = 1.0

    def update(
        self,
        rows: Rows,
        closer: Closer | None = None,
        peaks: Peaks | None = None,
        seen: float | None = None,
    ) -> float:
        """
        Take in rows as for `sequence_scores`; return the velocity, references per frame.

        In the better scores that `closer` leads to, one other than 1 or -1 must stand out, too;
        one that is `seen` otherwise competes there, and so does what won before. `peaks` is what
        finds them, if not here.
        """
        if len(rows) >= VELOCITY.shortest and rows[0] is not None:
            steps = np.array([diagonal(len(rows), one) for one in self._velocities])
            if peaks is None:
                found = kernels_of(__package__).peaks(rows, steps, self._bounds.starts)
            else:
                found = peaks(rows, steps)
            highest, mean, counts = found.T
            if counts[0] >= VELOCITY.fewest_sequences:
                now = (highest - mean) ** VELOCITY.power
                if not self._prominence.any():
                    self._prominence = now
                self._prominence += (now - self._prominence) / VELOCITY.memory
        likely = [self._velocities[int((self._weights * self._prominence).argmax())]]
        if closer is None:
            return likely[0]
        if seen is not None:
            off = abs(np.array(self._velocities) / seen - 1)
            likely += [self._velocities[off.argmin()]] if off.min() < VELOCITY.spacing else []
        likely.append(self._last)
        if all(one == 1.0 for one in likely):
            self._closely.clear()
            return 1.0
        same = [one for one in self._velocities if abs(one) == 1.0]
        for one in (asked := dict.fromkeys((*same, *likely))):
            scores = closer(one)
            close = _prominence(scores[np.isfinite(scores)])
            before = self._closely.get(one, close)
            self._closely[one] = before + (close - before) / VELOCITY.close_memory
        self._last = max(asked, key=lambda one: _weight(one) * self._closely[one])
        return self._last


def _weight(velocity: float) -> float:
    return VELOCITY.preference ** ((abs(velocity) != 1.0) + (velocity < 0))


def _prominence(scores: Values) -> float:
    return float(scores.max() - scores.mean()) ** VELOCITY.power if scores.size else 0.0
