# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The frame gate selects keyframes: the frames that are matched and become places.

A near-duplicate test recognises most other frames in 0.1 ms.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

from convseq_ros.config import Config, KeyframeConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor
from convseq_ros.core.gate.dropped_frames import FRAME_DROPS, FrameDropDetector
from convseq_ros.core.gate.near_duplicate import Glance, glance, NearDuplicate
from convseq_ros.core.gate.scenes import Scenes
from convseq_ros.core.gate.standstill import near, Standstill
from convseq_ros.core.similarity.overlap import Overlap, PaperSimilarity
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
    passed: int = 0  # scenes that the drive has passed, with this one


class FrameGate:
    """
    Selects frames that differ enough in scene, time and pose, while the robot moves.

    In a map that grows, it also counts the scenes that the drive has passed: of the keyframes that
    the default spacing selects, whatever the spacing is, those of a changed view. A reset does not
    change that number.
    """

    def __init__(
        self, config: Config, keyframes: KeyframeConfig, similarity: PaperSimilarity
    ) -> None:
        by_image = config.believes
        self._similarity, self._blank = similarity, blank_descriptor(config.encoding)
        self._standstill = Standstill(config.motion, by_image, similarity)
        self._overlap = Overlap(config.encoding.saliency_threshold, config.matching.kernel)
        self._drops = FrameDropDetector(FRAME_DROPS.memory if by_image else 0)
        self._keyframes, self._by_scene = keyframes, keyframes.keyframe_overlap < 1.0
        self._near_duplicate = NearDuplicate()
        self._interval_ns = round(KEYFRAME.earliest * keyframes.keyframe_interval_s * 1e9)
        self._by_default: FrameGate | None = None  # counts scenes, if the spacing is another
        if config.online.grows and keyframes.spacing != KeyframeConfig().spacing:
            self._by_default = FrameGate(config, KeyframeConfig(), similarity)
        self._scenes = Scenes()
        self.reset()

    def configure(self, config: Config) -> None:
        """Use another `stationary_m` from now on."""
        self._standstill.configure(config.motion)

    def reset(self) -> None:
        if self._by_default:
            self._by_default.reset()
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
        if self._by_default is None:
            verdict = self._check(stamp_ns, pose, encode, gray)
            return replace(verdict, passed=self._scenes.passed)
        encode_once = cache(encode)
        verdict = self._check(stamp_ns, pose, encode_once, gray)
        passed = self._by_default.check(stamp_ns, pose, encode_once, gray).passed
        return replace(verdict, passed=passed)

    def check_unreadable(self, stamp_ns: int, pose: Pose | None) -> int | None:
        """
        Return how many keyframes were dropped before a frame that cannot be read.

        None if it is no keyframe: it comes early, near the last one, or the scene would decide.
        """
        if self._by_default:
            self._by_default.check_unreadable(stamp_ns, pose)
        self._drops.observe(stamp_ns)
        if not self._is_due(stamp_ns, pose):
            return None
        if self._standstill.is_sure(pose, None):
            self._drops.observe_keyframe()
            return None
        return None if self._by_scene else self._keyframe(stamp_ns, pose)

    def _check(
        self, stamp_ns: int, pose: Pose | None, encode: Callable[[], Descriptor], gray: Gray | None
    ) -> Verdict:
        self._drops.observe(stamp_ns)
        if not self._is_due(stamp_ns, pose):
            return Verdict(Reason.BETWEEN_KEYFRAMES, self._blank)
        edges = None if gray is None else glance(gray)
        still = self._standstill.is_sure(pose, edges)
        # With scene spacing, standstill only names the reason.
        if still and not (self._by_scene and self._standstill.needs_image(pose)):
            return self._not_keyframe(still, pose, edges, self._blank)
        if self._by_scene and self._near_duplicate.is_sure(edges):
            return self._not_keyframe(still, pose, edges, self._blank)
        descriptor = encode()
        if self._by_scene:  # else uninformative frames are keyframes, too
            if not descriptor.informative:
                return Verdict(Reason.UNINFORMATIVE, descriptor)
            most, last = self._keyframes.keyframe_overlap, self._scene
            if last is not None and self._overlap(descriptor, last, most) > most:
                self._near_duplicate.note(edges, True)
                return self._not_keyframe(still, pose, edges, descriptor)
        # In the dark, noise alone may leave little overlap: compare the frames for standstill.
        unchanged = self._standstill.check(descriptor, pose, edges)
        self._near_duplicate.note(edges, unchanged)
        if unchanged:
            return self._not_keyframe(still or not self._by_scene, pose, edges, descriptor)
        if self._by_scene:
            self._scene = descriptor
        self._scenes.count(edges)
        return Verdict(None, descriptor, self._keyframe(stamp_ns, pose))

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
        self._standstill.note_passed(pose, edges)
        return Verdict(Reason.BETWEEN_KEYFRAMES, descriptor)

    def _is_due(self, stamp_ns: int, pose: Pose | None) -> bool:
        if self._last_ns is None or stamp_ns < self._last_ns:
            return True
        if stamp_ns - self._last_ns < self._interval_ns:
            return False
        if pose is None or self._pose is None:
            return True
        return not near(pose, self._pose, self._keyframes.keyframe_distance_m)
