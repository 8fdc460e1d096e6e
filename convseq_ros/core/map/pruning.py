# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which stretches of drives are removed where a map has too many of one place."""

from itertools import chain

from convseq_ros.core.graph.links import LINKS
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Halves
import numpy as np


@constants
class STRETCH:
    """Chosen by recall on a drawn lap that is driven 34 times, in changing light."""

    # Keyframes of a drive that are kept or removed together. If single keyframes are removed, the
    # frames of a sequence match different drives, and recall falls to 75 %.
    keyframes: int = 16
    # A new stretch is kept if its distance to every other is at least this many times the
    # smallest distance between two others. Noise alone, new in each lap, makes up to 1.8.
    further: float = 2.0


class Pruning:
    """
    Selects what to remove from a map that keeps `max_looks` stretches of a place; 0 is no limit.

    A stretch is 16 keyframes of one drive. If a place has too many, the later one of the two most
    similar stretches is removed, by their global descriptors. The newest is removed unless it is
    twice as far from all others as their closest pair. Anchors are kept. A place that was not
    recognised belongs to the place that its recognised neighbours imply.
    """

    def __init__(self, reference_map: ReferenceMap, most: int) -> None:
        self._map, self._most = reference_map, most
        self._kept = dict[int, list[int]]()  # stretches that are kept, by a place's first stretch
        self.surplus = list[int]()  # indices of places to remove, ascending
        if not most or not len(reference_map.links):
            return
        for places in reference_map.session_ranges:
            for stretch in places[:: STRETCH.keyframes]:
                first = {place: self._first(place) for place in self._places(stretch)}
                known = [place for place in first if first[place] < stretch]
                if 2 * len(known) > len(first):  # else most of the stretch is new
                    descriptor = reference_map.global_descriptors[known[0]]
                    removed = self._add(stretch, first[known[0]], descriptor)
                    self.surplus += self._places(removed) if removed is not None else ()
        self.surplus.sort()

    def has_room(self, place: int, descriptor: Halves) -> bool:
        """Return whether a stretch is kept that begins now at a place, with a descriptor (m,)."""
        new = len(self._map)
        return self._add(new, self._first(place), descriptor) != new

    def _add(self, stretch: int, first: int, descriptor: Halves) -> int | None:
        """Add a stretch to a place, given by its anchor; return the stretch to remove."""
        stretches = self._kept.setdefault(self._stretch(first), [self._stretch(first)])
        stretches.append(stretch)
        if not 0 < self._most < len(stretches):
            return None
        nearest = [
            min(self._places(other), key=lambda place: abs(self._first(place) - first))
            for other in stretches[:-1]
        ]
        rows = np.vstack([self._map.global_descriptors[nearest], descriptor]).astype(np.float32)
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.finfo(np.float32).tiny)
        followers = self._map.links.followers
        stay = np.array([any(map(followers, self._places(other))) for other in stretches])
        stay[0] = True
        distances = np.maximum(1 - rows @ rows.T, np.finfo(np.float32).eps)
        distances[-1] /= STRETCH.further  # the newest is removed first if images are the same
        distances[np.triu_indices(len(rows))] = np.inf
        distances[np.ix_(stay, stay)] = np.inf
        later, earlier = divmod(int(distances.argmin()), len(rows))
        if not np.isfinite(distances[later, earlier]):
            return None
        return stretches.pop(earlier if stay[later] else later)

    def _stretch(self, place: int) -> int:
        start, _ = self._map.bounds.span(place)
        return start + (place - start) // STRETCH.keyframes * STRETCH.keyframes

    def _places(self, stretch: int) -> range:
        _, end = self._map.bounds.span(stretch)
        return range(stretch, min(stretch + STRETCH.keyframes, end, len(self._map)))

    def _first(self, place: int) -> int:
        """Return the anchor of a place; if it is not linked, as a linked neighbour implies."""
        links, bounds = self._map.links, self._map.bounds
        steps = range(1, LINKS.neighbour_radius // 2 + 1)
        place = links.anchor(place)
        start, end = bounds.span(place)
        for offset in chain.from_iterable((step, -step) for step in steps):
            neighbour = place + offset
            if start <= neighbour < end and (anchor := links.anchor(neighbour)) != neighbour:
                implied = max(bounds.span(anchor)[0], anchor - offset)
                return self._first(implied) if implied < place else place
        return place
