# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The second witness: in how many blocks of the image keypoints agree with a place.

Keypoints repeat in like light only. How much the light of drive and map differs is read from the
mean brightness of both, on a coarse grid.
"""

from functools import lru_cache
import math

from convseq_ros.config import Config
from convseq_ros.core.encoding.brightness import brightness
from convseq_ros.core.encoding.keypoints import agreeing_blocks, Keypoints
from convseq_ros.core.map.image_coding import decode_jpeg
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Descriptor, Doubles, Frame, Gray
from convseq_ros.errors import MapError
import numpy as np

_KEPT = 64  # places whose keypoints are cached; 20 MB
_LOOKED_AT = 10  # places of a map, to know whether it has keypoints
_GROWTH = 1.25  # growth of the map after which its brightness is read again


@constants
class LIGHT:
    """How the brightness of drive and map is read."""

    places: int = 60  # of the map, evenly spread, that are read
    frames: int = 100  # memory of the drive's mean


def has_keypoints(reference_map: ReferenceMap) -> bool:
    """Return whether a map has keypoints, by a few of its places; also true if it is empty."""
    if not len(reference_map):
        return True
    some = np.unique(np.linspace(0, len(reference_map) - 1, _LOOKED_AT).astype(int)).tolist()
    return any(reference_map.keypoints(index) is not None for index in some)


def without_keypoints(name: object, has: bool, config: Config) -> str:
    """Return a line about a map that has no keypoints; empty if it has, or none are used."""
    if has or not (config.believes and config.keyframes.keypoints):
        return ''
    return (
        f'{name} has no keypoints, so alike aisles may be confused; build the map again to add '
        'them'
    )


class KeypointWitness:
    """Compares the newest frame with places of a map; `most` keypoints a frame, 0 for none."""

    def __init__(self, reference_map: ReferenceMap, most: int) -> None:
        self._map, self._most = reference_map, most
        self._read = 0  # number of places when the map's brightness was read
        self._of_map: Doubles | None = None

        @lru_cache(_KEPT)
        def of_place(index: int) -> Keypoints | None:
            stored = reference_map.keypoints(index)
            return None if stored is None else Keypoints.of_stored(stored)

        self._of_place = of_place
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._of_drive: Doubles | None = None
        self._frames = 0

    def keypoints(self, frame: Frame, descriptor: Descriptor) -> Keypoints | None:
        """Return the keypoints of a frame; None if it has none, or none are to be used."""
        stored = descriptor.keypoints
        if stored is None and frame.gray is not None:
            stored = self._map.detect(frame.gray, self._most)
        return Keypoints.of_stored(stored) if self._most and stored is not None else None

    def knows(self, place: int) -> bool:
        """Return whether keypoints of a place are to be used, and the map has some."""
        return self._most > 0 and self._of_place(place) is not None

    def blocks(self, query: Keypoints, place: int, motion: Doubles | None, side: int) -> int:
        """Return `agreeing_blocks` of a query and a place; 0 without keypoints or a motion."""
        known = self._of_place(place)
        if known is None or motion is None:
            return 0
        return agreeing_blocks(query, known, motion, side)

    def difference(self, frame: Frame, descriptor: Descriptor, usable: int) -> float:
        """
        Take in a frame; return how much drive and map differ in light, infinity if unknown.

        It is the mean difference of logarithms of brightness. Measured: .05 by day, .2 in
        corridor, .3 in the evening, .6 in rain, .9 at night.
        """
        if not self._most:
            return math.inf
        new = descriptor.brightness
        if new is None and frame.gray is not None:
            new = brightness(frame.gray)
        if new is not None:
            self._frames = min(self._frames + 1, LIGHT.frames)
            before = new if self._of_drive is None else self._of_drive
            self._of_drive = before + (new - before) / self._frames
        if usable > _GROWTH * self._read:
            self._read, self._of_map = usable, self._mean(usable)
        if self._of_drive is None or self._of_map is None:
            return math.inf
        return float(abs(self._of_drive - self._of_map).mean())

    def _mean(self, usable: int) -> Doubles | None:
        """Return the mean brightness (32,) of places' thumbnails; None without any."""
        places = np.unique(np.linspace(0, usable - 1, LIGHT.places).astype(int))
        images = [self._thumbnail(place) for place in places.tolist()]
        known = [brightness(image) for image in images if image is not None]
        return np.mean(known, axis=0) if known else None

    def _thumbnail(self, place: int) -> Gray | None:
        """Return the thumbnail (H, W) of a place; None if there is none, or it is damaged."""
        try:
            return decode_jpeg(self._map.thumbnail(place))
        except MapError:  # told where the cells of the place are read
            return None
