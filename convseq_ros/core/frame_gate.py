# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The frame gate: which frames are keyframes, to be matched and to become places."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
import math
from typing import Any

from convseq_ros.config import Config, KeyframeConfig, MatchingConfig, MotionConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor
from convseq_ros.core.encoding.entropy import ENTROPY
from convseq_ros.core.sequence.frame_drops import FrameDropDetector, NoFrameDrops
from convseq_ros.core.similarity.kernels.choice import chosen_kernels
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Descriptor, Pose, Reason


@dataclass(frozen=True, slots=True)
class GateConstants:
    """Of the gate; engineering, not studied."""

    clock_jump_ns: int = 1_000_000_000  # back; by less, a frame is late
    earliest: float = 0.9  # of an interval between keyframes: no camera keeps time exactly
    turn_rad: float = math.tau / 20  # from where on a robot that turns on the spot moves


GATE = GateConstants()
Order = Enum('Order', ['NEXT', 'LATE', 'JUMPED_BACK'])  # how a stamp follows those before it


class StampOrder:
    """Tells frames that come late from a clock that jumped back."""

    def __init__(self) -> None:
        self._last_ns: int | None = None

    def reset(self) -> None:
        self._last_ns = None

    def update(self, stamp_ns: int) -> Order:
        """Take in a stamp, nanoseconds; one that is late is forgotten."""
        late_ns = 0 if self._last_ns is None else self._last_ns - stamp_ns
        if 0 < late_ns <= GATE.clock_jump_ns:
            return Order.LATE
        self._last_ns = stamp_ns
        return Order.JUMPED_BACK if late_ns > 0 else Order.NEXT


def near(pose: Pose, other: Pose, distance_m: float) -> bool:
    """Return whether a pose is nearer than this to another, and turned by less than a 20th."""
    cosine = abs(sum(a * b for a, b in zip(pose.orientation, other.orientation, strict=True)))
    turn_rad = 2 * math.acos(min(cosine, 1.0))
    return math.dist(pose.position, other.position) < distance_m and turn_rad < GATE.turn_rad


class Standstill:
    """Compares each frame with the last that moved, so that creeping adds up."""

    def __init__(self, config: MotionConfig, by_image: bool, similarity: PaperSimilarity) -> None:
        self._config, self._similarity = config, similarity
        self._by_image = by_image and config.stationary_overlap < 1.0  # if there is no odometry
        self._pose: Pose | None = None
        self._descriptor: Descriptor | None = None

    def reset(self) -> None:
        self._pose = self._descriptor = None

    def update(self, descriptor: Descriptor, pose: Pose | None) -> bool:
        """
        Take in a frame; return whether the robot stands still since the last that moved.

        A frame that shows nothing counts as motion; the pose is that of odometry.
        """
        still, last = False, self._descriptor
        if not descriptor.informative:
            return False
        if pose and self._pose and self._config.stationary_m:
            still = near(pose, self._pose, self._config.stationary_m)
        elif self._by_image and last is not None:
            still = self._similarity(descriptor, last) > self._config.stationary_overlap
        if not still:
            self._pose, self._descriptor = pose, descriptor
        return still


class Overlap:
    """
    Compares images with one that is remembered, by their coherent score with normalised cells.

    What is left of it after a way depends on how near things are, hardly on the light. Scores are
    those of the definition, with any kernel.
    """

    def __init__(self, saliency_threshold: float, kernel: str = 'auto') -> None:
        _, self._pair = chosen_kernels(MatchingConfig(matching='coherent', kernel=kernel))
        self._least_bits = saliency_threshold * ENTROPY.max_bits
        self._remembered: Any = None

    def forget(self) -> None:
        self._remembered = None

    def remember(self, descriptor: Descriptor) -> None:
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
        self._config, self._overlap = config, overlap
        self._interval_ns = round(GATE.earliest * config.keyframe_interval_s * 1e9)
        self._last_ns: int | None = None
        self._pose: Pose | None = None

    def reset(self) -> None:
        self._last_ns = self._pose = None
        self._overlap.forget()

    def warm_up(self, drawn: Descriptor) -> None:
        """Compile or load what frames need, with any image; before the first frame."""
        if self._config.keyframe_overlap < 1.0:
            self._overlap.remember(drawn)
            self._overlap.of(drawn)
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


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the gate says of a frame."""

    reason: Reason | None  # why the frame is no keyframe; None for a keyframe
    descriptor: Descriptor  # what it shows; blank where nobody had to look
    missing: int = 0  # keyframes that were dropped before it, by the stamps of a steady stream


class FrameGate:
    """
    Passes frames that are apart by scene, time and way, while the robot moves.

    `keyframes` are as far apart as those of the map that they are matched with, or added to.
    """

    def __init__(
        self, config: Config, keyframes: KeyframeConfig, similarity: PaperSimilarity
    ) -> None:
        matching, by_image = config.matching, config.matching.matching == 'coherent'
        self._similarity, self._blank = similarity, blank_descriptor(config.encoding)
        self._standstill = Standstill(config.motion, by_image, similarity)
        overlap = Overlap(config.encoding.saliency_threshold, matching.kernel)
        self._keyframes = Keyframes(keyframes, overlap)
        counts = by_image and matching.velocity_search
        self._drops = FrameDropDetector() if counts else NoFrameDrops()

    def reset(self) -> None:
        """Forget the frames so far."""
        self._standstill.reset()
        self._keyframes.reset()
        self._drops.reset()

    def warm_up(self, drawn: Descriptor) -> None:
        """Compile or load what frames need, with an informative image; before the first frame."""
        self._keyframes.warm_up(drawn)
        self._similarity(drawn, drawn)

    def update(
        self, stamp_ns: int, pose: Pose | None, encode: Callable[[], Descriptor]
    ) -> Verdict:
        """Decide about the next frame; `encode` describes it, if time and way let it pass."""
        self._drops.update(stamp_ns)
        if not self._keyframes.is_due(stamp_ns, pose):
            return Verdict(Reason.BETWEEN_KEYFRAMES, self._blank)
        descriptor = encode()
        if self._standstill.update(descriptor, pose):
            self._drops.update_keyframe()
            return Verdict(Reason.STATIONARY, descriptor)
        reason = self._keyframes.update(stamp_ns, descriptor, pose)
        missing = 0 if reason else self._drops.update_keyframe()
        return Verdict(reason, descriptor, missing)
