# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which places of a map show nearly the same scene."""

from typing import Protocol

from convseq_ros.core.graph.links import LINKS, Links
from convseq_ros.core.graph.session_bounds import SessionBounds
from convseq_ros.core.types import Doubles, Flags, Indices
import numpy as np

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
