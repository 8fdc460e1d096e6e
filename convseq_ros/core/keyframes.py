# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which frames of a drive become references, and which are matched with them."""

from convseq_ros.config import KeyframeConfig
from convseq_ros.core.matching.regional import similarity
from convseq_ros.core.standstill import near
from convseq_ros.core.types import Descriptor, Pose

# A frame that comes a little early is the one that is due: no camera keeps time exactly.
_EARLIEST = 0.9


class KeyframeSelector:
    """
    Chooses frames that are apart by time, way and scene; every frame by default.

    Parameters
    ----------
    config : KeyframeConfig
        Least time and way, and largest similarity, between two keyframes.

    """

    def __init__(self, config: KeyframeConfig) -> None:
        self._config = config
        self._interval_ns = round(_EARLIEST * config.keyframe_interval_s * 1e9)
        self._last: tuple[int, Descriptor] | None = None
        self._pose: Pose | None = None

    @property
    def keeps_pace(self) -> bool:
        """Whether the keyframes of a steady stream are one, since time alone decides."""
        return not self._config.keyframe_distance_m and self._config.keyframe_overlap == 1.0

    def reset(self) -> None:
        """Forget the frames chosen so far."""
        self._last = self._pose = None

    def is_due(self, stamp_ns: int, pose: Pose | None = None) -> bool:
        """Return whether a frame is far enough from the last keyframe, whatever it shows."""
        if self._last is None or stamp_ns < self._last[0]:
            return True
        if stamp_ns - self._last[0] < self._interval_ns:
            return False
        if pose is None or self._pose is None:
            return True
        return not near(pose, self._pose, self._config.keyframe_distance_m)

    def wants(self, stamp_ns: int, descriptor: Descriptor, pose: Pose | None = None) -> bool:
        """
        Decide about the next frame; a wanted one is the last keyframe from then on.

        Uninformative frames are wanted only where the scene does not decide.
        """
        overlap = self._config.keyframe_overlap
        if not self.is_due(stamp_ns, pose):
            return False
        if overlap < 1.0 and not descriptor.informative:
            return False
        if overlap < 1.0 and self._last and similarity(descriptor, self._last[1]) > overlap:
            return False
        self._last, self._pose = (stamp_ns, descriptor), pose or self._pose
        return True
