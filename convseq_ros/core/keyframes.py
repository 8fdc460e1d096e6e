# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keyframes: frames that are apart by scene, time and way."""

from dataclasses import dataclass, replace
from typing import Any

from convseq_ros.config import KeyframeConfig, MatchingConfig
from convseq_ros.core.encoding.entropy import ENTROPY
from convseq_ros.core.similarity.kernels.choice import chosen_kernels
from convseq_ros.core.standstill import near
from convseq_ros.core.types import Descriptor, Pose, Reason


@dataclass(frozen=True, slots=True)
class KeyframeConstants:
    """Of keyframes; engineering, not studied."""

    earliest: float = 0.9  # of an interval: no camera keeps time exactly


KEYFRAMES = KeyframeConstants()


class Overlap:
    """
    Compares images with one that is remembered, by their coherent score with normalised cells.

    A robot that drives on sees less and less move together, by day as in the evening: what is left
    after a way depends on how near things are, hardly on the light. Scores are those of the
    definition, with any kernel.
    """

    def __init__(self, saliency_threshold: float, kernel: str = 'auto') -> None:
        _, self._pair = chosen_kernels(MatchingConfig(matching='coherent', kernel=kernel))
        self._least_bits = saliency_threshold * ENTROPY.max_bits
        self._remembered: Any = None

    def forget(self) -> None:
        """Remember no image."""
        self._remembered = None

    def remember(self, descriptor: Descriptor) -> None:
        """Compare with this image from now on."""
        self._remembered = self._pair.prepare(self._normalized(descriptor).cells, None)

    def of(self, descriptor: Descriptor) -> float:
        """Return what moved together, as a share in [0, 1]; 0 where nothing is remembered."""
        query = self._pair.extract(self._normalized(descriptor), self._least_bits, None)
        if query is None or self._remembered is None:
            return 0.0
        return float(self._pair.compare(query, [self._remembered])[0][0])

    def _normalized(self, descriptor: Descriptor) -> Descriptor:
        normalize = self._pair.normalize
        return replace(descriptor, cells=normalize(descriptor.cells)) if normalize else descriptor


class Keyframes:
    """Chooses frames that are apart by scene, time and way, and remembers the last."""

    def __init__(self, config: KeyframeConfig, overlap: Overlap) -> None:
        self._config = config
        self._overlap = overlap
        self._interval_ns = round(KEYFRAMES.earliest * config.keyframe_interval_s * 1e9)
        self._last_ns: int | None = None
        self._pose: Pose | None = None

    def warm_up(self, drawn: Descriptor) -> None:
        """Compile or load what frames need, with any image; before the first frame."""
        if self._config.keyframe_overlap < 1.0:
            self._overlap.remember(drawn)
            self._overlap.of(drawn)
            self._overlap.forget()

    def reset(self) -> None:
        """Forget the frames chosen so far."""
        self._last_ns = self._pose = None
        self._overlap.forget()

    def is_due(self, stamp_ns: int, pose: Pose | None = None) -> bool:
        """Return whether a frame is far enough from the last keyframe, whatever it shows."""
        if self._last_ns is None or stamp_ns < self._last_ns:
            return True
        if stamp_ns - self._last_ns < self._interval_ns:
            return False
        if pose is None or self._pose is None:
            return True
        return not near(pose, self._pose, self._config.keyframe_distance_m)

    def update(
        self, stamp_ns: int, descriptor: Descriptor, pose: Pose | None = None
    ) -> Reason | None:
        """
        Decide about a frame that is due; None, and remembered, if it is a keyframe.

        Uninformative frames are keyframes only where the scene does not decide.
        """
        if self._config.keyframe_overlap < 1.0:
            if not descriptor.informative:
                return Reason.UNINFORMATIVE
            if self._overlap.of(descriptor) > self._config.keyframe_overlap:
                return Reason.BETWEEN_KEYFRAMES
            self._overlap.remember(descriptor)
        self._last_ns, self._pose = stamp_ns, pose or self._pose
        return None
