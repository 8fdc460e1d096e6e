# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which frames of a drive become references, and which are matched with them."""

from convseq_ros.config import KeyframeConfig
from convseq_ros.core.matching.regional import similarity
from convseq_ros.core.standstill import near
from convseq_ros.core.types import Descriptor, Pose


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
        self._interval_ns = round(config.keyframe_interval_s * 1e9)
        self._last: tuple[int, Descriptor, Pose | None] | None = None

    @property
    def keeps_pace(self) -> bool:
        """Whether the keyframes of a steady stream are one, since time alone decides."""
        return not self._config.keyframe_distance_m and self._config.keyframe_overlap == 1.0

    def reset(self) -> None:
        """Forget the frames chosen so far."""
        self._last = None

    def is_due(self, stamp_ns: int, pose: Pose | None = None) -> bool:
        """Return whether a frame is far enough from the last keyframe, whatever it shows."""
        if self._last is None:
            return True
        last_ns, _, last_pose = self._last
        if stamp_ns < last_ns:
            return True
        if stamp_ns - last_ns < self._interval_ns:
            return False
        if pose is None or last_pose is None:
            return True
        return not near(pose, last_pose, self._config.keyframe_distance_m)

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
        self._last = stamp_ns, descriptor, pose
        return True
