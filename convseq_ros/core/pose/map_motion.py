# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motions between places of one drive, from the map's poses."""

import math

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import inverse, Matrix, matrix
from convseq_ros.core.types import constants, RelativePose


@constants
class NEIGHBOURS:
    """The choice of neighbours; tuned on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    reach: int = 10  # places to either side that are searched
    count: int = 2  # neighbours that give depth; one on either side is better than two on one
    apart_m: float = 1.8  # least distance to the first neighbour, and from each to the next
    most_turned: float = 0.8  # least cosine of the turn to a neighbour
    nearer_m: float = 0.3  # the pose is measured again from a place that is nearer by this


class MapMotion:
    """Motions between places of a map, which may grow."""

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map

    def moved(self, index: int, other: int) -> Matrix | None:
        """Return the motion (4, 4) of the base from a place to another of its drive, if known."""
        if self._distance_m(index, other) is None:
            return None
        first, second = self._map.places[index].pose, self._map.places[other].pose
        assert first and second
        return inverse(matrix(second)) @ matrix(first)

    def _distance_m(self, index: int, other: int) -> float | None:
        """Return the distance between two places of one drive, if known."""
        places = self._map.places
        if not (0 <= index < len(places) and 0 <= other < len(places)):
            return None
        first, second = places.position(index), places.position(other)
        if first is None or second is None or places.session(index) != places.session(other):
            return None
        return math.dist(first, second)

    def neighbours(self, index: int, times: int = 1) -> list[tuple[int, Matrix]]:
        """
        Return neighbours on both sides of a place, or on one side, and the motions to them.

        Returns `times` more neighbours, at 1/`times` of the spacing.
        """
        sides = [self._on_side(index, side, times) for side in (-1, 1)]
        if all(sides):
            sides = [neighbours[: times * NEIGHBOURS.count // 2] for neighbours in sides]
        return [neighbour for neighbours in sides for neighbour in neighbours]

    def _on_side(self, index: int, side: int, times: int) -> list[tuple[int, Matrix]]:
        """Return neighbours before a place (side -1) or after it (1), up to 2 `times`."""
        neighbours: list[tuple[int, Matrix]] = []
        last_m = 0.0
        for step in range(1, NEIGHBOURS.reach + 1):
            distance_m = self._distance_m(index, other := index + side * step)
            if distance_m is None or len(neighbours) == times * NEIGHBOURS.count:
                break
            if distance_m < last_m + NEIGHBOURS.apart_m / times:
                continue
            moved = self.moved(index, other)
            if moved is not None and moved[0, 0] >= NEIGHBOURS.most_turned:
                neighbours.append((other, moved))
                last_m = distance_m
        return neighbours

    def nearest(self, index: int, pose: RelativePose) -> int:
        """Return the place nearest to a pose that is relative to place `index` of its drive."""
        places, reference = self._map.places, self._map.places[index]
        if pose.position_m is None or reference.pose is None:
            return index
        here = (matrix(reference.pose) @ (*pose.position_m, 1.0))[:3]
        best, least_m = index, math.hypot(*pose.position_m) - NEIGHBOURS.nearer_m
        near = self._map.bounds.around(index, NEIGHBOURS.reach)
        for other in range(near.start, min(near.stop, len(places))):
            position = places.position(other)
            if position is not None and (distance_m := math.dist(position, here)) < least_m:
                best, least_m = other, distance_m
        return best
