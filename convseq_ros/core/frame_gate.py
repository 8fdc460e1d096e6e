# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The frame gate selects keyframes: the frames that are matched and become places.

A near-duplicate test recognises most other frames in 0.1 ms. Gaps between the stamps of a steady
stream show how many frames were dropped.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
import math
import statistics

from convseq_ros.config import Config, KeyframeConfig, MotionConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor
from convseq_ros.core.glance import distance, GLANCE, Glance, glance, NearnessByGlance
from convseq_ros.core.similarity.overlap import Overlap, PaperSimilarity
from convseq_ros.core.types import constants, Descriptor, Gray, Pose, Reason


@constants
class GATE:
    """Constants of the gate; chosen by experience, not tuned."""

    clock_jump_ns: int = 1_000_000_000  # a frame that is late by more means that the clock jumped
    earliest: float = 0.9  # share of the interval between keyframes, as cameras are not exact
    turn_rad: float = math.tau / 20  # smallest turn that counts as motion


Order = Enum('Order', ['NEXT', 'LATE', 'JUMPED_BACK'])  # of a stamp after the ones before


class StampOrder:
    """Distinguishes frames that come late from a clock that jumped back."""

    _last_ns: int | None = None

    def reset(self) -> None:
        self._last_ns = None

    def check(self, stamp_ns: int) -> Order:
        """Return the order of the next stamp, nanoseconds; a late one is then forgotten."""
        late_ns = 0 if self._last_ns is None else self._last_ns - stamp_ns
        if 0 < late_ns <= GATE.clock_jump_ns:
            return Order.LATE
        self._last_ns = stamp_ns
        return Order.JUMPED_BACK if late_ns > 0 else Order.NEXT

    def are_next(self, stamps_ns: Sequence[int]) -> bool:
        """Return whether stamps would all be in order, each after the one before."""
        last = [] if self._last_ns is None else [self._last_ns]
        return all(earlier <= later for earlier, later in pairwise([*last, *stamps_ns]))


class AnyOrder(StampOrder):
    """Treats every frame as the next, whatever its stamp."""

    def check(self, _stamp_ns: int) -> Order:
        """Return NEXT."""
        return Order.NEXT


@constants
class FRAME_DROPS:
    """A steady stream; chosen by hand on recordings with known drops (docs/MATCHING.md)."""

    memory: int = 20  # number of recent intervals in use
    fewest: int = 8  # smallest number of intervals; with fewer, no drops are reported
    tolerance: float = 0.25  # by which a multiple of the usual interval may be off
    steady_share: float = 0.8  # smallest share of intervals that are multiples


class FrameDropDetector:
    """
    Counts dropped frames, if most intervals between frames are multiples of a short one.

    With a `memory` of fewer than 8 intervals, no frame is ever reported as dropped.
    """

    def __init__(self, memory: int = FRAME_DROPS.memory) -> None:
        self._memory = memory
        self.reset()

    def reset(self) -> None:
        self._last_ns: int | None = None
        self._intervals_ns: deque[int] = deque(maxlen=self._memory)
        self._frames, self._missing, self._stride = 0, 0, 1

    def observe(self, stamp_ns: int) -> int:
        """Return how many frames were dropped between the frame before and this one."""
        missing, usual_ns = 0, self._usual_ns()
        if self._last_ns is not None:
            interval_ns = stamp_ns - self._last_ns
            if interval_ns > 0:
                self._intervals_ns.append(interval_ns)
            missing = max(0, round(interval_ns / usual_ns) - 1) if usual_ns else 0
        self._last_ns = stamp_ns
        self._frames += 1
        self._missing += missing
        return missing

    def observe_keyframe(self) -> int:
        """Make the newest frame a keyframe; return how many keyframes were dropped before it."""
        missing = self._missing // self._stride
        self._frames, self._missing, self._stride = 0, 0, max(1, self._frames)
        return missing

    def _usual_ns(self) -> float | None:
        if len(self._intervals_ns) < FRAME_DROPS.fewest:
            return None
        usual_ns = statistics.quantiles(self._intervals_ns, n=4)[0]
        steps = [interval_ns / usual_ns for interval_ns in self._intervals_ns]
        steady = sum(abs(step - max(1, round(step))) <= FRAME_DROPS.tolerance for step in steps)
        return usual_ns if steady >= FRAME_DROPS.steady_share * len(steps) else None


def near(pose: Pose, other: Pose, distance_m: float) -> bool:
    """Return whether a pose is within a distance of another, and turned by less than 18°."""
    cosine = abs(sum(a * b for a, b in zip(pose.orientation, other.orientation, strict=True)))
    turn_rad = 2 * math.acos(min(cosine, 1.0))
    return math.dist(pose.position, other.position) < distance_m and turn_rad < GATE.turn_rad


class Standstill:
    """Detects standstill by the last frame that moved, so that slow motion adds up."""

    def __init__(self, config: MotionConfig, by_image: bool, similarity: PaperSimilarity) -> None:
        self._config, self._similarity = config, similarity
        self._by_image = by_image and config.stationary_overlap < 1.0  # if there is no odometry
        self._most_apart = GLANCE.still * (1.0 - config.stationary_overlap)
        self.reset()

    def reset(self) -> None:
        self._pose: Pose | None = None
        self._seen: Glance | None = None
        self._descriptor: Descriptor | None = None

    def check(self, descriptor: Descriptor, pose: Pose | None, seen: Glance | None = None) -> bool:
        """Return whether the robot stands still at a frame; False if it is uninformative."""
        if not descriptor.informative:
            return False
        if (still := self._by_pose(pose)) is None:
            still, last = False, self._descriptor
            if self._by_image and last is not None and not self._apart(seen) > GLANCE.moved:
                most = self._config.stationary_overlap
                still = self._similarity(descriptor, last, most) > most
        if not still:
            self._pose, self._seen, self._descriptor = pose, seen, descriptor
        return still

    def is_sure(self, pose: Pose | None, seen: Glance | None) -> bool:
        """Return whether the robot surely stands still, by its pose or a near-duplicate test."""
        if not self.needs_image(pose):
            return bool(self._by_pose(pose))
        return self._apart(seen) < self._most_apart

    def _apart(self, seen: Glance | None) -> float:
        """Return the distance of a glance from that of the last frame that moved, or NaN."""
        return math.nan if seen is None or self._seen is None else distance(seen, self._seen)

    def note_passed(self, pose: Pose | None, seen: Glance | None) -> None:
        """Store the pose and glance of a frame that moved and is not described."""
        self._pose, self._seen = pose or self._pose, seen

    def needs_image(self, pose: Pose | None) -> bool:
        """Return whether the image decides, because there is no pose to compare."""
        return self._by_image and self._by_pose(pose) is None

    def _by_pose(self, pose: Pose | None) -> bool | None:
        if pose and self._pose and self._config.stationary_m:
            return near(pose, self._pose, self._config.stationary_m)
        return None


@dataclass(frozen=True, slots=True)
class Verdict:
    """The gate's decision about a frame."""

    reason: Reason | None  # why the frame is not a keyframe; None for a keyframe
    descriptor: Descriptor  # of the frame; blank if it was not needed
    missing: int = 0  # keyframes that were dropped before it, by the stamps of a steady stream


class FrameGate:
    """Selects frames that differ enough in scene, time and pose, while the robot moves."""

    def __init__(
        self, config: Config, keyframes: KeyframeConfig, similarity: PaperSimilarity
    ) -> None:
        by_image = config.believes
        self._similarity, self._blank = similarity, blank_descriptor(config.encoding)
        self._standstill = Standstill(config.motion, by_image, similarity)
        self._overlap = Overlap(config.encoding.saliency_threshold, config.matching.kernel)
        self._drops = FrameDropDetector(FRAME_DROPS.memory if by_image else 0)
        self._keyframes, self._by_scene = keyframes, keyframes.keyframe_overlap < 1.0
        self._glances = NearnessByGlance()
        self._interval_ns = round(GATE.earliest * keyframes.keyframe_interval_s * 1e9)
        self.reset()

    def reset(self) -> None:
        self._standstill.reset()
        self._drops.reset()
        self._glances.reset()
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
        seen = None if gray is None else glance(gray)
        still = self._standstill.is_sure(pose, seen)
        # If scenes are compared, a still image does not decide yet: it may only set the reason.
        if still and not (self._by_scene and self._standstill.needs_image(pose)):
            return self._not_keyframe(still, pose, seen, self._blank)
        if self._by_scene and self._glances.is_sure(seen):
            return self._not_keyframe(still, pose, seen, self._blank)
        descriptor = encode()
        if self._by_scene:  # else uninformative frames are keyframes, too
            if not descriptor.informative:
                return Verdict(Reason.UNINFORMATIVE, descriptor)
            share, last = self._keyframes.keyframe_overlap, self._scene
            if last is not None and self._overlap(descriptor, last, share) > share:
                self._glances.learn(seen, True)
                return self._not_keyframe(still, pose, seen, descriptor)
        # In the dark, noise alone may leave little overlap: compare the frames for standstill.
        unchanged = self._standstill.check(descriptor, pose, seen)
        self._glances.learn(seen, unchanged)
        if unchanged:
            return self._not_keyframe(still or not self._by_scene, pose, seen, descriptor)
        if self._by_scene:
            self._scene = descriptor
        self._last_ns, self._pose = stamp_ns, pose or self._pose
        return Verdict(None, descriptor, self._drops.observe_keyframe())

    def _not_keyframe(
        self, still: bool, pose: Pose | None, seen: Glance | None, descriptor: Descriptor
    ) -> Verdict:
        """Return the verdict on a frame at standstill, or close to the last keyframe."""
        if still:
            self._drops.observe_keyframe()
            return Verdict(Reason.STATIONARY, descriptor)
        self._standstill.note_passed(pose, seen)
        return Verdict(Reason.BETWEEN_KEYFRAMES, descriptor)

    def _is_due(self, stamp_ns: int, pose: Pose | None) -> bool:
        if self._last_ns is None or stamp_ns < self._last_ns:
            return True
        if stamp_ns - self._last_ns < self._interval_ns:
            return False
        if pose is None or self._pose is None:
            return True
        return not near(pose, self._pose, self._keyframes.keyframe_distance_m)
