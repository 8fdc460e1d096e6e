# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is near a place of the map: the places beside it, and its looks with those beside them."""

from convseq_ros.core.graph.links import LINKS
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Doubles, Flags, Indices
import numpy as np


class Neighbourhood:
    """Knows which places of a map show much the same as one of them."""

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map

    def ranges(self, index: int, distance: int = LINKS.beside) -> list[range]:
        """Return the places of each session within a distance of a place, or of a look of it."""
        looks = (index, *self._map.links.looks(index))
        return [self._map.bounds.around(one, distance) for one in looks]

    def mask(self, places: Indices, index: int, distance: int = LINKS.beside) -> Flags:
        """Return which of some places (n,) are near one."""
        found = np.zeros(len(places), np.bool_)
        for some in self.ranges(index, distance):
            found |= (places >= some.start) & (places < some.stop)
        return found

    def beside(self, places: Indices, index: int, distance: int) -> Flags:
        """Return which of some places (n,) are of the same session, within a distance."""
        return self._map.bounds.near(places, index, distance)

    def best_beside(
        self, places: Indices, others: Indices, values: Doubles, reach: int, loss: float = 0.0
    ) -> Doubles:
        """
        Return of places (n,) the best value of others (m,) at most so far off in their session.

        It is less by so much for each place between; -inf where there is none.
        """
        near = self._map.bounds.nearness(places, others, reach)
        found = values[:, None] - loss * abs(places - others[:, None])
        return np.where(near, found, -np.inf).max(axis=0, initial=-np.inf)

    def is_near(self, one: int, other: int, distance: int = LINKS.beside) -> bool:
        """Return whether a place is near another."""
        return any(one in some for some in self.ranges(other, distance))
