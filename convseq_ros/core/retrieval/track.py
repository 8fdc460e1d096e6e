# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The track: coarse scores summed along the drive."""

from convseq_ros.core.types import constants, Indices, Row
import numpy as np


@constants
class TRACK:
    """The sums along the drive; tuned by recall on drawn and real sets."""

    memory: float = 0.8  # share of a predecessor's sum that is passed on, per keyframe
    reach: int = 3  # largest number of places that a drive passes per keyframe


class Track:
    """
    Sums of coarse scores along the drive, one for each place.

    The sum of a place is its score plus 80 % of the last sum of the best place just before it. So
    one pass over the row replaces sequence matching at all velocities up to `reach`. In `both`
    directions, the places just after it count as well. Sums stay within a session.
    """

    def __init__(self, both: bool) -> None:
        self._both = both
        self.reset()

    def reset(self) -> None:
        self.sums: Row = np.zeros(0, np.float32)

    def update(self, row: Row, starts: Indices) -> None:
        """Take in the scores of the newest query (R,); sessions begin at `starts`."""
        before, old = self.sums, len(self.sums)
        if not old:
            self.sums = row.copy()
            return
        if len(row) > old:
            before = np.append(before, np.full(len(row) - old, before.min(), np.float32))
        best, bounds = before.copy(), starts[1:]
        for step in range(1, TRACK.reach + 1):
            earlier, later = before[:-step], before[step:]
            if len(bounds):  # nothing is passed on from one session to another
                crosses = np.zeros(len(row), np.bool_)
                for back in range(step):
                    crosses[bounds[bounds + back < len(row)] + back] = True
                earlier = np.where(crosses[step:], -np.inf, earlier)
                later = np.where(crosses[step:], -np.inf, later)
            np.maximum(best[step:], earlier, out=best[step:])
            if self._both:
                np.maximum(best[:-step], later, out=best[:-step])
        best *= TRACK.memory
        best += row
        self.sums = best
