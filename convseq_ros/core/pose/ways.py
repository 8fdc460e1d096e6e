# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the places of one drive lie to each other, by the poses that its map has of them."""

import math

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import inverse, Matrix, matrix
from convseq_ros.core.types import constants, RelativePose


@constants
class WAYS:
    """Which places help; chosen on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    look: int = 10  # to either side, among which are neighbours
    count: int = 2  # neighbours that give depth; one on either side is better than two on one
    apart_m: float = 1.8  # that a neighbour is off the place, and the next off the one before
    most_turned: float = 0.8  # cosine of the turn to a neighbour, at least
    nearer_m: float = 0.3  # by which another place must lie nearer, to be measured from


class Ways:
    """Ways between places of a map, which may grow."""

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map

    def moved(self, index: int, other: int) -> Matrix | None:
        """Return the motion from the base at a place to that at another of its drive, if known."""
        if self._way_m(index, other) is None:
            return None
        one, two = self._map.places[index].pose, self._map.places[other].pose
        assert one and two
        return inverse(matrix(two)) @ matrix(one)

    def _way_m(self, index: int, other: int) -> float | None:
        """Return how far apart two places of one drive are, if known."""
        places = self._map.places
        if not (0 <= index < len(places) and 0 <= other < len(places)):
            return None
        one, two = places.position(index), places.position(other)
        if one is None or two is None or places.session(index) != places.session(other):
            return None
        return math.dist(one, two)

    def neighbours(self, index: int, times: int = 1) -> list[tuple[int, Matrix]]:
        """
        Return places on both sides of a place, or on one, and motions to them.

        They are so many times as many as usual, and as close to each other.
        """
        sides = [self._on_side(index, side, times) for side in (-1, 1)]
        if all(sides):
            sides = [found[: times * WAYS.count // 2] for found in sides]
        return [one for found in sides for one in found]

    def _on_side(self, index: int, side: int, times: int) -> list[tuple[int, Matrix]]:
        """Return places before a place (-1) or after it (1), as many at most."""
        found: list[tuple[int, Matrix]] = []
        last_m = 0.0
        for step in range(1, WAYS.look + 1):
            way_m = self._way_m(index, other := index + side * step)
            if way_m is None or len(found) == times * WAYS.count:
                break
            if way_m < last_m + WAYS.apart_m / times:
                continue
            moved = self.moved(index, other)
            if moved is not None and moved[0, 0] >= WAYS.most_turned:
                found.append((other, moved))
                last_m = way_m
        return found

    def nearest(self, index: int, pose: RelativePose) -> int:
        """Return the place of the same drive that lies nearest to a pose against a place."""
        places, own = self._map.places, self._map.places[index]
        if pose.position_m is None or own.pose is None:
            return index
        here = (matrix(own.pose) @ (*pose.position_m, 1.0))[:3]
        best, least_m = index, math.hypot(*pose.position_m) - WAYS.nearer_m
        near = self._map.bounds.around(index, WAYS.look)
        for other in range(near.start, min(near.stop, len(places))):
            position = places.position(other)
            if position is not None and (way_m := math.dist(position, here)) < least_m:
                best, least_m = other, way_m
        return best
