# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The near-duplicate test: edges of small copies of two images tell whether they are alike."""

from collections import deque

from convseq_ros.core.types import constants, Floats, Gray
import cv2
import numpy as np

Glance = Floats  # (2, 48, 64) of length 1, hence the same in a dimmer light

_AREA = cv2.INTER_AREA  # each pixel is the mean of those that it covers


@constants
class GLANCE:
    """Chosen on drawn drives of 30 frames a second, by day and night (docs/MATCHING.md)."""

    width_px: int = 64
    height_px: int = 48
    least_edge: float = 0.3  # root mean square, in roots of a grey level; of less, nothing is said
    memory: int = 5  # frames that were found far lately
    share: float = 0.9  # of the least distance that was safe lately, below which all is near
    surprise: float = 0.7  # of that distance is safe if a far frame comes before any near one
    beside: float = 0.25  # of that distance lies a frame at most from one that shows the same
    # Twice the distance of any of 262 pairs of images that are 98.5 % alike: with noise, in 3 % to
    # all of the light, up to 4 pixels apart.
    moved: float = 0.7
    still: float = 4.0  # distance by which frames differ at most, by how unlike they may be


def glance(gray: Gray) -> Glance | None:
    """Return the edges of a small copy of an image (H, W); None if there are hardly any."""
    size = width, height = GLANCE.width_px, GLANCE.height_px
    # Halves are made four times as fast as other shares.
    while min(gray.shape[0] // height, gray.shape[1] // width) >= 8 and not any(
        side % 2 for side in gray.shape
    ):
        gray = cv2.resize(gray, (gray.shape[1] // 2, gray.shape[0] // 2), interpolation=_AREA)
    small = np.sqrt(cv2.resize(gray, size, interpolation=_AREA), dtype=np.float32)
    edges: Glance = np.stack([cv2.Sobel(small, -1, 1, 0), cv2.Sobel(small, -1, 0, 1)])
    length = float(np.linalg.norm(edges))
    if length < GLANCE.least_edge * edges.size**0.5:
        return None
    edges /= length
    return edges


def distance(seen: Glance, other: Glance) -> float:
    """Return how far apart two glances are, in [0, 2]."""
    return float(np.linalg.norm(seen - other))


class NearnessByGlance:
    """
    Tells by glances alone which frames a slower test would find near to the last far one.

    It learns from that test how far away frames are safely near; what nobody tested does not
    count, so that it cannot grow by its own word.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self._last: Glance | None = None  # of the last far one
        self._near: Glance | None = None  # of the furthest that was found near since
        self._furthest = 0.0  # how far that is
        self._safe = deque[float](maxlen=GLANCE.memory)

    def is_sure(self, seen: Glance | None) -> bool:
        """Return whether the slower test would surely find a frame near."""
        if seen is None or self._last is None or not self._safe:
            return False
        found, safe = distance(seen, self._last), min(self._safe)
        if found < GLANCE.share * safe or self._near is None:
            return found < GLANCE.share * safe
        return found <= self._furthest and distance(seen, self._near) < GLANCE.beside * safe

    def update(self, seen: Glance | None, is_near: bool) -> None:
        """Take in what the slower test says of a frame; a far one is what others are near to."""
        if is_near:
            if seen is not None and self._last is not None:
                found = distance(seen, self._last)
                if found >= self._furthest:
                    self._furthest, self._near = found, seen
            return
        if self._last is not None:
            surprise = GLANCE.surprise * min(self._safe, default=0.0)
            self._safe.append(self._furthest or surprise)
        self._last, self._near, self._furthest = seen, None, 0.0
