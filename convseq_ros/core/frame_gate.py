# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The frame gate: which frames are keyframes, to be matched and to become places."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import auto, Enum

from convseq_ros.config import Config, KeyframeConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor
from convseq_ros.core.keyframes import Keyframes, Overlap
from convseq_ros.core.sequence.frame_drops import FrameDropDetector, NoFrameDrops
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.standstill import Standstill
from convseq_ros.core.types import Descriptor, Pose, Reason

_CLOCK_JUMP_NS = 1_000_000_000  # back; by less, a frame is late. Engineering, not studied.


class Order(Enum):
    """How a stamp follows those before it."""

    NEXT = auto()
    LATE = auto()
    JUMPED_BACK = auto()


class StampOrder:
    """Tells frames that come late from a clock that jumped back."""

    def __init__(self) -> None:
        self._last_ns: int | None = None

    def reset(self) -> None:
        """Forget the last stamp."""
        self._last_ns = None

    def update(self, stamp_ns: int) -> Order:
        """Take in a stamp, nanoseconds; one that is late is forgotten."""
        late_ns = 0 if self._last_ns is None else self._last_ns - stamp_ns
        if 0 < late_ns <= _CLOCK_JUMP_NS:
            return Order.LATE
        self._last_ns = stamp_ns
        return Order.JUMPED_BACK if late_ns > 0 else Order.NEXT


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
        kernel, threshold = config.matching.kernel, config.encoding.saliency_threshold
        by_image = config.matching.matching == 'coherent'
        self._standstill = Standstill(config.motion, by_image, similarity)
        self._keyframes = Keyframes(keyframes, Overlap(threshold, kernel))
        counts = by_image and config.matching.velocity_search
        self._similarity = similarity
        self._blank = blank_descriptor(config.encoding)
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
