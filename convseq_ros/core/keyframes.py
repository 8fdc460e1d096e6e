# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which frames of a drive become references, and which are matched with them."""

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.overlap import Overlap
from convseq_ros.core.standstill import near
from convseq_ros.core.types import Descriptor, Pose

# A frame that comes a little early is the one that is due: no camera keeps time exactly.
_EARLIEST = 0.9


class KeyframeSelector:
    """
    Chooses frames that are apart by scene, time and way.

    Parameters
    ----------
    config : KeyframeConfig
        Largest overlap, and least time and way, between two keyframes.
    encoding : EncodingConfig
        What is salient, which overlaps are about.
    kernel : str
        What computes overlaps; as in MatchingConfig.

    """

    def __init__(
        self,
        config: KeyframeConfig,
        encoding: EncodingConfig = EncodingConfig(),
        kernel: str = 'auto',
    ) -> None:
        self._config = config
        self._interval_ns = round(_EARLIEST * config.keyframe_interval_s * 1e9)
        self._overlap: Overlap | None = None
        if config.keyframe_overlap < 1.0:
            self._overlap = Overlap(encoding.saliency_threshold, kernel)
        self._last_ns: int | None = None
        self._pose: Pose | None = None

    def warm_up(self, drawn: Descriptor) -> None:
        """Compile or load what frames will need, with any image; before the first frame."""
        if self._overlap:
            self._overlap.remember(drawn)
            self._overlap.of(drawn)
            self._overlap.forget()

    def reset(self) -> None:
        """Forget the frames chosen so far."""
        self._last_ns = self._pose = None
        if self._overlap:
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

    def wants(self, stamp_ns: int, descriptor: Descriptor, pose: Pose | None = None) -> bool:
        """
        Decide about the next frame; a wanted one is the last keyframe from then on.

        Uninformative frames are wanted only where the scene does not decide.
        """
        if not self.is_due(stamp_ns, pose):
            return False
        if self._overlap:
            if not descriptor.informative:
                return False
            if self._overlap.of(descriptor) > self._config.keyframe_overlap:
                return False
            self._overlap.remember(descriptor)
        self._last_ns, self._pose = stamp_ns, pose or self._pose
        return True
