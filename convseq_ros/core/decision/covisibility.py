# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What keypoints agree: of the newest frame with places, and of places with each other.

Two places of a map are covisible by the share of a scene that the other shows. Keypoints of the
map's own images tell it, as images of one drive have one light; cells alone call alike places
covisible. The share is that of the place's neighbours, which show nearly all of it.

Sources: Mur-Artal et al. 2015 (ORB-SLAM: keyframes that share points are covisible).
"""

from functools import lru_cache, partial

from convseq_ros.core.encoding.keypoints import (
    agreeing_blocks,
    agreeing_by_chance,
    common_shift,
    Keypoints,
    matched,
)
from convseq_ros.core.geometry.verification import motion
from convseq_ros.core.graph.neighbourhood import SAME_PLACE
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.scorer import Scorer
from convseq_ros.core.types import constants, Descriptor, Doubles, Frame, Indices
import numpy as np

_KEPT_PLACES = 64  # places whose keypoints are cached; 20 MB


class KeypointWitness:
    """Compares the newest frame with places of a map; `most` keypoints a frame, 0 for none."""

    def __init__(self, reference_map: ReferenceMap, most: int) -> None:
        self._map, self._most = reference_map, most

        @lru_cache(_KEPT_PLACES)
        def of_place(index: int) -> Keypoints | None:
            stored = reference_map.keypoints(index) if most else None
            return None if stored is None else Keypoints.of_stored(stored)

        self.of_place = of_place

    def keypoints(self, frame: Frame, descriptor: Descriptor) -> Keypoints | None:
        """Return the keypoints of a frame; None if it has none, or none are to be used."""
        stored = descriptor.keypoints
        if stored is None and frame.gray is not None:
            stored = self._map.detect(frame.gray, self._most)
        return Keypoints.of_stored(stored) if self._most and stored is not None else None

    def knows(self, place: int) -> bool:
        """Return whether keypoints of a place are to be used, and the map has some."""
        return self.of_place(place) is not None

    def blocks(self, query: Keypoints, place: int, motion: Doubles | None, side: int) -> int:
        """Return `agreeing_blocks` of a query and a place; 0 without keypoints or a motion."""
        known = self.of_place(place)
        if known is None or motion is None:
            return 0
        return agreeing_blocks(matched(query, known), motion, side)


_KEPT = 4_000  # pairs of places whose blocks are cached


@constants
class COVISIBLE:
    """In how many blocks keypoints of two images agree; chosen on real drives (docs/NOTES.md)."""

    # So many agree in images of other scenes, at most; more are a share of the scene.
    by_chance: float = 5.0
    in_view: int = 3  # at most so many agree with a place that is out of view


class Covisibility:
    """Which places of a map show the same scene; without keypoints, none shares any."""

    def __init__(
        self, reference_map: ReferenceMap, matcher: Scorer, witness: KeypointWitness
    ) -> None:
        self._map = reference_map
        # Not a bound method: without a reference cycle, an unused map is freed at once.
        self._blocks = lru_cache(_KEPT)(partial(_blocks, matcher, witness))

    def share(self, place: int, other: int) -> float:
        """Return the share of the scene of a place that another shows, in [0, 1]."""
        chance = COVISIBLE.by_chance
        first, end = self._map.bounds.span(place)
        beside = [at for at in (place - 1, place + 1) if first <= at < min(end, len(self._map))]
        whole = max([2 * chance, *(self._between(place, at) for at in beside)])
        return min(1.0, max(0.0, (self._between(place, other) - chance) / (whole - chance)))

    def shares(self, place: int, others: Indices) -> Doubles:
        """Return the shares (n,) of the scene of a place that others (n,) show."""
        return np.array([self.share(place, other) for other in others.tolist()])

    def shown(self, place: int, among: Indices) -> tuple[Indices, Doubles]:
        """Return which of places (m,) show some of the scene of one, (n,), and its shares."""
        shares = self.shares(place, among)
        return among[shares > 0], shares[shares > 0]

    def is_in_view(self, place: int) -> bool:
        """
        Return whether a place has been in view ever since it was added.

        Places that show some of the newest one's scene lead back to it from there, none further
        from the next than what counts as the same place: something may pass before the camera.
        """
        newest = seen = len(self._map) - 1
        while seen > place:
            next_ones = range(max(place, seen - SAME_PLACE), seen)
            shown = (one for one in next_ones if self._between(newest, one) > COVISIBLE.in_view)
            if (before := next(shown, None)) is None:
                return False
            seen = before
        return True

    def _between(self, one: int, other: int) -> float:
        return self._blocks(max(one, other), min(one, other))


def _blocks(matcher: Scorer, witness: KeypointWitness, one: int, other: int) -> float:
    """
    Return in how many blocks the keypoints of two places agree, as their cells moved.

    As many as would if they had moved anywhere in the image are left out.
    """
    here, there = witness.of_place(one), witness.of_place(other)
    if here is None or there is None or not len(matches := matched(here, there)):
        return 0.0
    images = matcher.packed(one), matcher.packed(other)
    if images[0] is None or images[1] is None:
        return 0.0
    side = images[0].side
    moved = motion(images[0], images[1], common_shift(matches, side))
    return agreeing_blocks(matches, moved, side) - agreeing_by_chance(len(matches), side)
