# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How alike two frames of a drive are: the overlap of their regions, and a test by glances."""

from collections import deque
from dataclasses import replace
from typing import Any

from convseq_ros.core.encoding.descriptor import ENTROPY
from convseq_ros.core.encoding.glance import distance, Glance
from convseq_ros.core.similarity.kernels import coherent_kernel
from convseq_ros.core.types import constants, Descriptor


class Overlap:
    """
    The coherent score of normalised cells, without a background; what is compared with is kept.

    How fast it falls along a drive depends on the distance of things, hardly on the light.
    """

    def __init__(self, saliency_threshold: float) -> None:
        self._pair, self._least_bits = coherent_kernel(), saliency_threshold * ENTROPY.max_bits
        self._prepared: tuple[Descriptor | None, Any] = None, None  # what was compared with

    def __call__(self, query: Descriptor, other: Descriptor) -> float:
        """Return the score of a query and another image, in [0, 1]; 0 for one without regions."""
        pair = self._pair
        image = replace(query, cells=pair.normalize(query.cells))
        if (features := pair.extract(image, self._least_bits)) is None:
            return 0.0
        if self._prepared[0] is not other:
            self._prepared = other, pair.prepare(pair.normalize(other.cells), None)
        return float(pair.compare(features, [self._prepared[1]])[0][0])


@constants
class NEAR:
    """Chosen on drawn drives at 30 frames per second, by day and night (docs/NOTES.md)."""

    # Frames closer to the last keyframe than this share of the learned distance are near. With up
    # to 0.75, all keyframes of 11 drives at 1 to 8 m/s are those of the slower test; with 0.78,
    # one by night comes a frame late.
    share: float = 0.75
    memory: int = 3  # keyframes it is learned from; with 1, it errs from a share of 0.7 on
    again: float = 0.07  # largest distance to a frame that was found near, for a robot that waits
    # Frames closer than this to the last keyframe are near, however little overlap noise leaves.
    # Noise of 10 levels moves a picture of 160 x 120 px by up to .28, of 15 levels one of
    # 320 x 240 px by up to .22. Keyframes are further apart: 98 % of those of laps, and all of 12
    # other drives.
    noise: float = 0.28


class NearDuplicate:
    """
    Predicts by glances whether a slower test will find a frame near to the last far frame.

    It learns from that test how far away near frames are, as this differs between scenes and
    lights. Predictions do not count as results of the test, so errors cannot accumulate.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self._last: Glance | None = None  # of the last far frame
        self._near: Glance | None = None  # of the furthest near frame since
        self._furthest = 0.0  # distance between these two
        self._learned = deque[float](maxlen=NEAR.memory)  # such distances, before far frames

    def is_sure(self, edges: Glance | None) -> bool:
        """Return whether the slower test would surely find a frame near."""
        if edges is None or self._last is None:
            return False
        away = distance(edges, self._last)
        if away < max(self._most, NEAR.noise):
            return True
        if self._near is None or away > self._furthest:
            return False
        return distance(edges, self._near) < NEAR.again

    def note(self, edges: Glance | None, is_near: bool) -> None:
        """Take in a result of the slower test; a far frame becomes the new reference."""
        if not is_near:
            if self._last is not None:
                # Without a tested near frame, predictions may have gone too far: learn less.
                self._learned.append(self._furthest or self._most)
            self._last, self._near, self._furthest = edges, None, 0.0
        elif edges is not None and self._last is not None:
            away = distance(edges, self._last)
            if away >= self._furthest:
                self._furthest, self._near = away, edges

    @property
    def _most(self) -> float:
        """The distance below which frames are near; 0 before any is learned."""
        return NEAR.share * min(self._learned, default=0.0)
