# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Glances: small copies of images, which tell in a tenth of a millisecond what is surely near."""

from collections import deque
import math

from convseq_ros.core.constants import constants
import cv2
import numpy as np
import numpy.typing as npt

Glance = npt.NDArray[np.float32]  # a small image less its mean


@constants
class GLANCE:
    """Chosen on drawn drives of 30 frames a second, by day and night (docs/MATCHING.md)."""

    width_px: int = 32
    height_px: int = 24
    least_contrast: float = 2.0  # grey levels; of less, nothing is said
    memory: int = 10  # tested frames that are remembered of either kind
    fewest: int = 3  # of those that were far, without which nothing is sure
    share: float = 0.6  # of the least distance of a far one, below which a frame is surely near


def glance(gray: npt.NDArray[np.uint8]) -> Glance | None:
    """Return a small copy of an image (H, W), less its mean; None if it hardly shows anything."""
    size = GLANCE.width_px, GLANCE.height_px
    small = cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    small -= small.mean()
    return small if small.std() >= GLANCE.least_contrast else None


class NearnessByGlance:
    """
    Tells by glances alone which frames a slower test would find near to the last far one.

    It learns from that test. A frame is surely near if it is much nearer than all that were
    lately found far, and no further than one that was found near. Where a test divides what lies
    `apart`, nothing is sure while ones that were found near are not much nearer themselves.
    """

    def __init__(self, apart: bool = False) -> None:
        self._apart = apart
        self.reset()

    def reset(self) -> None:
        self._last: Glance | None = None
        self._near = deque[float](maxlen=GLANCE.memory)
        self._far = deque[float](maxlen=GLANCE.memory)

    def is_sure(self, seen: Glance | None) -> bool:
        """Return whether the slower test would surely find a frame near."""
        if len(self._far) < GLANCE.fewest or not self._near:
            return False
        least, most = GLANCE.share * min(self._far), max(self._near)
        if self._apart and most >= least:
            return False
        return self._distance(seen) < min(least, most)

    def update(self, seen: Glance | None, is_near: bool) -> None:
        """Take in what the slower test says of a frame; a far one is what others are near to."""
        distance = self._distance(seen)
        if math.isfinite(distance):
            (self._near if is_near else self._far).append(distance)
        if not is_near:
            self._last = seen

    def _distance(self, seen: Glance | None) -> float:
        """Return the root mean square difference from the last, in standard deviations of it."""
        if seen is None or self._last is None:
            return math.inf
        return float(np.linalg.norm(seen - self._last) / np.linalg.norm(self._last))
