# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The sessions of a map, and which of its places show nearly the same scene."""

from bisect import bisect_right
import sys
from typing import Protocol

from convseq_ros.core.graph.links import LINKS, Links
from convseq_ros.core.types import Doubles, Flags, Indices
import numpy as np


class SessionBounds:
    """
    Where the sessions of a map begin and end; at first there is one session, from place 0.

    Places of different sessions are never neighbours, even if their indices are. One thread may
    begin sessions while other threads read.
    """

    def __init__(self, starts: tuple[int, ...] = ()) -> None:
        self._starts, self.starts = [0], np.zeros(1, np.int64)  # (S,), ascending
        for start in starts:
            self.begin(start)

    def begin(self, start: int) -> None:
        """Begin a session at a place; do nothing unless it is after the last session's start."""
        if start > self._starts[-1]:
            self._starts.append(start)
            self.starts = np.array(self._starts, np.int64)

    def span(self, index: int) -> tuple[int, int]:
        """Return the first place of a place's session and of the next; the last has no end."""
        after = bisect_right(self._starts, index)
        end = self._starts[after] if after < len(self._starts) else sys.maxsize
        return self._starts[after - 1], end

    def spans(self, indices: Indices) -> tuple[Indices, Indices] | tuple[int, int]:
        """Return what `span` does for places (n,)."""
        if len(self._starts) == 1:
            return 0, sys.maxsize
        after = np.searchsorted(self.starts, indices, 'right')
        return self.starts[after - 1], np.append(self.starts, sys.maxsize)[after]

    def around(self, index: int, distance: int) -> range:
        """Return the places of a session within a distance of one; may run beyond the map."""
        first, end = self.span(index)
        return range(max(first, index - distance), min(end, index + distance + 1))

    def near(self, indices: Indices, index: int, distance: int) -> Flags:
        """Return which places (n,) are of the same session as one, within a distance."""
        neighbours = self.around(index, distance)
        return (indices >= neighbours.start) & (indices < neighbours.stop)

    def nearness(self, indices: Indices, others: Indices, distance: int) -> Flags:
        """Return what `near` does for places (n,) and each of `others` (m,), as (m, n)."""
        apart, bounds = abs(indices - others[:, None]), self.spans(others)
        first, end = (np.broadcast_to(bound, others.shape)[:, None] for bound in bounds)
        return (apart <= distance) & (indices >= first) & (indices < end)


# Places to either side of one, and of its looks, that count as the same place.
SAME_PLACE = LINKS.neighbour_radius // 2


class Graph(Protocol):
    """The sessions and links of a map, which may grow."""

    @property
    def bounds(self) -> SessionBounds: ...

    @property
    def links(self) -> Links: ...


class Neighbourhood:
    """Which places of a map show nearly the same as a given one: its neighbours and looks."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph

    def ranges(self, index: int) -> list[range]:
        """Return the ranges of places near a place and near each of its looks."""
        looks = (index, *self._graph.links.looks(index))
        return [self._graph.bounds.around(look, LINKS.neighbour_radius) for look in looks]

    def mask(self, places: Indices, index: int, distance: int = LINKS.neighbour_radius) -> Flags:
        """Return which of `places` (n,) are near a place or one of its looks."""
        bounds, looks = self._graph.bounds, self._graph.links.looks(index)
        is_near = bounds.near(places, index, distance)
        if looks:
            is_near |= bounds.nearness(places, np.array(looks), distance).any(axis=0)
        return is_near

    def within(self, places: Indices, index: int, distance: int) -> Flags:
        """Return which of `places` (n,) are within a distance of a place in its session."""
        return self._graph.bounds.near(places, index, distance)

    def distances(self, places: Indices, others: Indices, reach: int) -> Doubles:
        """Return the distances (m, n) of others (m,) from places (n,); inf beyond the reach."""
        near = self._graph.bounds.nearness(places, others, reach)
        return np.where(near, abs(places - others[:, None]), np.inf)

    def is_near(self, place: int, index: int, distance: int = LINKS.neighbour_radius) -> bool:
        """Return whether a place is near another or one of its looks."""
        return bool(self.mask(np.array([place]), index, distance)[0])
