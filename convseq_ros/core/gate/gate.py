# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The frame gate selects keyframes: the frames that are matched and become places.

A near-duplicate test recognises most other frames in 0.1 ms.
"""

from collections.abc import Callable
from dataclasses import dataclass

from convseq_ros.config import Config, KeyframeConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor
from convseq_ros.core.encoding.glance import Glance, glance
from convseq_ros.core.gate.dropped_frames import FRAME_DROPS, FrameDropDetector
from convseq_ros.core.gate.near_duplicate import NearDuplicate
from convseq_ros.core.gate.standstill import near, Standstill
from convseq_ros.core.similarity.overlap import Overlap
from convseq_ros.core.types import constants, Descriptor, Gray, Pose, Reason


@constants
class KEYFRAME:
    """Engineering."""

    earliest: float = 0.9  # share of the interval between keyframes, as cameras are not exact


@dataclass(frozen=True, slots=True)
class Verdict:
    """The gate's decision about a frame."""

    reason: Reason | None  # why the frame is not a keyframe; None for a keyframe
    descriptor: Descriptor  # of the frame; blank if it was not needed
    missing: int = 0  # keyframes that were dropped before it, by the stamps of a steady stream
    edges: Glance | None = None  # of a keyframe


class FrameGate:
    """Selects frames that differ enough in scene, time and pose, while the robot moves."""

    def __init__(self, config: Config, keyframes: KeyframeConfig) -> None:
        by_image = config.believes
        self._blank = blank_descriptor(config.encoding)
        self._standstill = Standstill(config.motion, by_image)
        self._overlap = Overlap(config.encoding.saliency_threshold)
        self._drops = FrameDropDetector(FRAME_DROPS.memory if by_image else 0)
        self._keyframes, self._most = keyframes, keyframes.keyframe_overlap
        self._by_scene = self._most < 1.0
        self._near_duplicate = NearDuplicate()
        self._interval_ns = round(KEYFRAME.earliest * keyframes.keyframe_interval_s * 1e9)
        self.reset()

    def configure(self, config: Config) -> None:
        """Use another `stationary_m` from now on."""
        self._standstill.configure(config.motion)

    def reset(self) -> None:
        self._standstill.reset()
        self._drops.reset()
        self._near_duplicate.reset()
        self._last_ns: int | None = None  # stamp of the last keyframe; pose and scene as well
        self._pose: Pose | None = None
        self._scene: Descriptor | None = None

    def check(
        self,
        stamp_ns: int,
        pose: Pose | None,
        encode: Callable[[], Descriptor],
        gray: Gray | None = None,
    ) -> Verdict:
        """Return the verdict on the next frame; `encode` describes it if that is needed."""
        self._drops.observe(stamp_ns)
        if not self._is_due(stamp_ns, pose):
            return Verdict(Reason.BETWEEN_KEYFRAMES, self._blank)
        edges = None if gray is None else glance(gray)
        still = self._standstill.check(pose, edges)
        # With scene spacing, standstill by the image only names the reason.
        if still and not (self._by_scene and self._standstill.needs_image(pose)):
            return self._not_keyframe(still, pose, edges, self._blank)
        if self._by_scene and self._near_duplicate.is_sure(edges):
            return self._not_keyframe(still, pose, edges, self._blank)
        descriptor = encode()
        if self._by_scene:  # else uninformative frames are keyframes, too
            if not descriptor.informative:
                return Verdict(Reason.UNINFORMATIVE, descriptor)
            last = self._scene
            is_near = last is not None and self._overlap(descriptor, last) > self._most
            self._near_duplicate.note(edges, is_near)
            if is_near:
                return self._not_keyframe(still, pose, edges, descriptor)
            self._scene = descriptor
        self._standstill.note(pose, edges)
        return Verdict(None, descriptor, self._keyframe(stamp_ns, pose), edges)

    def check_unreadable(self, stamp_ns: int, pose: Pose | None) -> int | None:
        """
        Return how many keyframes were dropped before a frame that cannot be read.

        None if it is no keyframe: it comes early, near the last one, or the scene would decide.
        """
        self._drops.observe(stamp_ns)
        if not self._is_due(stamp_ns, pose):
            return None
        if self._standstill.check(pose, None):
            self._drops.observe_keyframe()
            return None
        return None if self._by_scene else self._keyframe(stamp_ns, pose)

    def _keyframe(self, stamp_ns: int, pose: Pose | None) -> int:
        """Note that a frame is a keyframe; return how many were dropped before it."""
        self._last_ns, self._pose = stamp_ns, pose or self._pose
        return self._drops.observe_keyframe()

    def _not_keyframe(
        self, still: bool, pose: Pose | None, edges: Glance | None, descriptor: Descriptor
    ) -> Verdict:
        """Return the verdict on a frame at standstill, or close to the last keyframe."""
        if still:
            self._drops.observe_keyframe()
            return Verdict(Reason.STATIONARY, descriptor)
        self._standstill.note(pose, edges)
        return Verdict(Reason.BETWEEN_KEYFRAMES, descriptor)

    def _is_due(self, stamp_ns: int, pose: Pose | None) -> bool:
        if self._last_ns is None or stamp_ns < self._last_ns:
            return True
        if stamp_ns - self._last_ns < self._interval_ns:
            return False
        if pose is None or self._pose is None:
            return True
        return not near(pose, self._pose, self._keyframes.keyframe_distance_m)
