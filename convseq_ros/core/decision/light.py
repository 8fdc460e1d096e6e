# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How much the light differs from that in which places were seen: by brightness on a coarse grid.

Keypoints repeat in like light only.
"""

from convseq_ros.core.decision.budget import BUDGET
from convseq_ros.core.decision.expected_lead import KEYPOINTS
from convseq_ros.core.encoding.brightness import brightness
from convseq_ros.core.map.image_coding import decode_jpeg
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Descriptor, Doubles, Frame, Gray, Indices
from convseq_ros.errors import MapError
import numpy as np


@constants
class LIGHT:
    """How light is told by brightness; engineering."""

    frames: int = 10  # memory of the drive's mean: the last seconds (docs/NOTES.md)


class Light:
    """
    The light of one camera's drive, and of the places of its map; without `is_read` it is unknown.

    A place of an earlier drive was seen in the mean light of its session; a place of the running
    drive in the same light as the newest frame.
    """

    def __init__(self, reference_map: ReferenceMap, is_read: bool) -> None:
        self._map, self._is_read = reference_map, is_read
        self._of_sessions = dict[int, Doubles | None]()  # mean brightness (32,), by first place
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._now: Doubles | None = None
        self._frames = 0

    def observe(self, frame: Frame, descriptor: Descriptor) -> None:
        """Take in the brightness of the newest frame."""
        if not self._is_read:
            return
        new = descriptor.brightness
        if new is None and frame.gray is not None:
            new = brightness(frame.gray)
        if new is None:
            return
        if self._now is None or abs(new - self._now).mean() >= KEYPOINTS.dark:
            self._now, self._frames = new, 0  # as where a tunnel begins
        memory = min(self._frames + 1, LIGHT.frames)
        self._now = self._now + (new - self._now) / memory
        self._frames += 1

    def differences(self, places: Indices, earlier: int) -> Doubles:
        """
        Return by how much (n,) the light differs from that of places (n,); infinity if unknown.

        It is the mean difference of logarithms of brightness. Measured: .05 by day, .2 in
        corridor, .3 in the evening, .6 in rain, .9 at night. The first `earlier` places are those
        of earlier drives. Others were seen in the same light: the difference is 0. Brightness
        cannot tell night from shade there, which differs by as much along a walk by day.
        """
        is_earlier = places < earlier
        if self._now is None:
            return np.where(is_earlier, np.inf, 0.0)
        firsts, _ = self._map.bounds.spans(places)
        found = np.zeros(len(places))
        for first in np.unique(np.broadcast_to(firsts, places.shape)[is_earlier]).tolist():
            found[is_earlier & (firsts == first)] = self._difference(first)
        return found

    def _difference(self, first: int) -> float:
        """Return the difference from the session that begins with a place."""
        assert self._now is not None
        then = self._of_session(first)
        return np.inf if then is None else float(abs(self._now - then).mean())

    def _of_session(self, first: int) -> Doubles | None:
        """Return the mean brightness (32,) of an earlier drive, by its first place."""
        if first not in self._of_sessions:
            _, end = self._map.bounds.span(first)
            last = min(end, len(self._map)) - 1
            places = np.unique(np.linspace(first, last, BUDGET.seen).astype(int))
            images = [self._thumbnail(place) for place in places.tolist()]
            known = [brightness(image) for image in images if image is not None]
            self._of_sessions[first] = np.mean(known, axis=0) if known else None
        return self._of_sessions[first]

    def _thumbnail(self, place: int) -> Gray | None:
        """Return the thumbnail (H, W) of a place; None if there is none, or it is damaged."""
        try:
            return decode_jpeg(self._map.thumbnail(place))
        except MapError:  # told where the cells of the place are read
            return None
