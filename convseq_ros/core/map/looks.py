# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The looks of each place of a map, of which so many are kept."""

from itertools import chain, pairwise

from convseq_ros.core.constants import constants
from convseq_ros.core.graph.links import LINKS
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Halves
import numpy as np


@constants
class LOOK:
    """By recall on a drawn round that is driven 34 times (scripts/links.py --part round)."""

    # Keyframes of a drive that stay or go together: without those beside them, the frames of a
    # sequence meet other places, and recall falls to .75.
    stretch: int = 16
    # A new look stays if it is so many times as far from all others as two of these are from each
    # other. Noise alone, anew in each round, makes up to 1.8.
    further: float = 2.0


class Looks:
    """
    Tells which looks of a place a map does without that keeps `max_looks` of each; 0 is no limit.

    A look is a stretch of one drive. Of more looks of a place the one that is most like another
    goes, by the global descriptors of what shows the place; of the two, the later one. The newest
    goes unless it is much less like them than they are like each other. Anchors stay. What was not
    recognised counts as if it had been, by what was beside it.
    """

    def __init__(self, reference_map: ReferenceMap, max_looks: int) -> None:
        self._map, self._most = reference_map, max_looks
        self._of = dict[int, list[int]]()  # stretches that are kept, by the first one of a place
        self.surplus = list[int]()  # places that the map does without
        if not max_looks or not len(reference_map.links):
            return
        for start, end in pairwise([*reference_map.bounds.starts.tolist(), len(reference_map)]):
            for stretch in range(start, end, LOOK.stretch):
                first = {place: self._first(place) for place in self._places(stretch)}
                looks = [place for place in first if first[place] < stretch]
                if 2 * len(looks) > len(first):  # else it shows more that is new
                    shown = reference_map.global_descriptors[looks[0]]
                    gone = self._take(stretch, first[looks[0]], shown)
                    self.surplus += self._places(gone) if gone is not None else ()

    def has_room(self, known: int, descriptor: Halves) -> bool:
        """Return whether a stretch is kept that begins now at a place, with a descriptor (m,)."""
        new = len(self._map)
        return self._take(new, self._first(known), descriptor) != new

    def _take(self, stretch: int, first: int, descriptor: Halves) -> int | None:
        """Keep a further stretch of a place, with its first look; return which one goes for it."""
        own = self._of.setdefault(self._stretch(first), [self._stretch(first)])
        own.append(stretch)
        if not 0 < self._most < len(own):
            return None
        shown = [
            min(self._places(one), key=lambda place: abs(self._first(place) - first))
            for one in own[:-1]
        ]
        rows = np.vstack([self._map.global_descriptors[shown], descriptor]).astype(np.float32)
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.finfo(np.float32).tiny)
        stay = np.array([not at or self._stays(one) for at, one in enumerate(own)])
        apart = np.maximum(1 - rows @ rows.T, np.finfo(np.float32).eps)
        apart[-1] /= LOOK.further  # so that of images that are the same, the newest goes
        apart[np.triu_indices(len(rows))] = np.inf
        apart[np.ix_(stay, stay)] = np.inf
        later, sooner = divmod(int(apart.argmin()), len(rows))
        if not np.isfinite(apart[later, sooner]):
            return None
        return own.pop(sooner if stay[later] else later)

    def _stretch(self, place: int) -> int:
        start, _ = self._map.bounds.span(place)
        return start + (place - start) // LOOK.stretch * LOOK.stretch

    def _places(self, stretch: int) -> range:
        _, end = self._map.bounds.span(stretch)
        return range(stretch, min(stretch + LOOK.stretch, end, len(self._map)))

    def _stays(self, stretch: int) -> bool:
        return any(self._map.links.followers(place) for place in self._places(stretch))

    def _first(self, place: int) -> int:
        """Return the first look of a place, or where it would be if it had been recognised."""
        links, bounds = self._map.links, self._map.bounds
        place = links.anchor(place)
        start, end = bounds.span(place)
        near = range(1, LINKS.beside // 2 + 1)
        for off in chain.from_iterable((one, -one) for one in near):
            if start <= place + off < end and (there := links.anchor(place + off)) != place + off:
                passed = max(bounds.span(there)[0], there - off)
                return self._first(passed) if passed < place else place
        return place


def surplus(reference_map: ReferenceMap, max_looks: int) -> list[int]:
    """Return which places a map does without that keeps so many looks of each; 0 is no limit."""
    return sorted(Looks(reference_map, max_looks).surplus)
