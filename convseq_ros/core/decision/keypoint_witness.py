# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The second witness: in how many blocks of the image keypoints agree with a place."""

from functools import lru_cache

from convseq_ros.core.encoding.keypoints import agreeing_blocks, Keypoints, matched
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor, Doubles, Frame

_KEPT = 64  # places whose keypoints are cached; 20 MB


class KeypointWitness:
    """Compares the newest frame with places of a map; `most` keypoints a frame, 0 for none."""

    def __init__(self, reference_map: ReferenceMap, most: int) -> None:
        self._map, self._most = reference_map, most

        @lru_cache(_KEPT)
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
