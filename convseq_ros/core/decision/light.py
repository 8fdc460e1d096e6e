# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The light of a drive and of the map, by their mean brightness on a coarse grid.

Keypoints repeat in like light only.
"""

import math

from convseq_ros.core.encoding.brightness import brightness
from convseq_ros.core.map.image_coding import decode_jpeg
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Descriptor, Doubles, Frame, Gray
from convseq_ros.errors import MapError
import numpy as np


@constants
class LIGHT:
    """How the brightness of drive and map is read."""

    places: int = 60  # of the map, evenly spread, that are read
    frames: int = 100  # memory of the drive's mean
    growth: float = 1.25  # of the map, after which it is read again


class Light:
    """The light of one camera's drive and of its map; without `is_read` it is unknown."""

    def __init__(self, reference_map: ReferenceMap, is_read: bool) -> None:
        self._map, self._is_read = reference_map, is_read
        self._read = 0  # number of places when the map's brightness was read
        self._of_map: Doubles | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._of_drive: Doubles | None = None
        self._frames = 0

    def difference(self, frame: Frame, descriptor: Descriptor, usable: int) -> float:
        """
        Take in a frame; return how much drive and map differ in light, infinity if unknown.

        It is the mean difference of logarithms of brightness. Measured: .05 by day, .2 in
        corridor, .3 in the evening, .6 in rain, .9 at night.
        """
        if not self._is_read:
            return math.inf
        new = descriptor.brightness
        if new is None and frame.gray is not None:
            new = brightness(frame.gray)
        if new is not None:
            self._frames = min(self._frames + 1, LIGHT.frames)
            before = new if self._of_drive is None else self._of_drive
            self._of_drive = before + (new - before) / self._frames
        if usable > LIGHT.growth * self._read:
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
