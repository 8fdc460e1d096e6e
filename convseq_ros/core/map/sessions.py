# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the sessions of a map begin: what is near a place, and what a diagonal may meet."""

from bisect import bisect_right
import sys

from convseq_ros.core.types import Indices
import numpy as np
import numpy.typing as npt


class SessionBounds:
    """
    The bounds of a map's sessions, which lie one after another; at first one that begins at 0.

    Places of different sessions are not near each other, whatever their numbers. One thread may
    begin sessions while others ask.
    """

    def __init__(self, starts: tuple[int, ...] = ()) -> None:
        self._starts, self.starts = [0], np.zeros(1, np.int64)  # (S,), ascending
        for start in starts:
            self.begin(start)

    def begin(self, start: int) -> None:
        """Have a session begin at a place that comes after all sessions so far."""
        if start > self._starts[-1]:
            self._starts.append(start)
            self.starts = np.array(self._starts, np.int64)

    def span(self, index: int) -> tuple[int, int]:
        """Return the first place of a place's session, and the next one's; the last has no end."""
        after = bisect_right(self._starts, index)
        end = self._starts[after] if after < len(self._starts) else sys.maxsize
        return self._starts[after - 1], end

    def spans(self, indices: Indices) -> tuple[Indices, Indices] | tuple[int, int]:
        """Return the same of places (n,)."""
        if len(self._starts) == 1:
            return 0, sys.maxsize
        after = np.searchsorted(self.starts, indices, 'right')
        return self.starts[after - 1], np.append(self.starts, sys.maxsize)[after]

    def around(self, index: int, distance: int) -> range:
        """Return the places of the same session within a distance, and perhaps beyond the map."""
        first, end = self.span(index)
        return range(max(first, index - distance), min(end, index + distance + 1))

    def near(self, indices: Indices, index: int, distance: int) -> npt.NDArray[np.bool_]:
        """Return which of some places (n,) are of the same session, within a distance."""
        there = self.around(index, distance)
        return (indices >= there.start) & (indices < there.stop)
