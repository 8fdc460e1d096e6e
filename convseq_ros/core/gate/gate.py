# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The frame gate selects keyframes: the frames that are matched and become places.

It knows the order of stamps, dropped frames and standstill. A near-duplicate test recognises most
other frames in 0.1 ms.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
import math
import statistics

from convseq_ros.config import Config, KeyframeConfig, MotionConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor
from convseq_ros.core.encoding.glance import distance, Glance, glance
from convseq_ros.core.gate.near_duplicate import NearDuplicate, Overlap
from convseq_ros.core.types import constants, Descriptor, Gray, Pose, Reason


@constants
class FRAME_DROPS:
    """A steady stream; engineering, tried on recordings with known drops."""

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


@constants
class NEAR:
    """Engineering."""

    turn_rad: float = math.tau / 20  # smallest turn that counts as motion


def near(pose: Pose, other: Pose, distance_m: float) -> bool:
    """Return whether a pose is within a distance of another, and turned by less than 18°."""
    cosine = abs(sum(a * b for a, b in zip(pose.orientation, other.orientation, strict=True)))
    turn_rad = 2 * math.acos(min(cosine, 1.0))
    return math.dist(pose.position, other.position) < distance_m and turn_rad < NEAR.turn_rad


class Standstill:
    """Detects standstill by the last frame that moved, so that slow motion adds up."""

    def __init__(self, config: MotionConfig, by_image: bool) -> None:
        self._config = config
        self._by_image = by_image and config.stationary_glance > 0  # if there is no odometry
        self.reset()

    def configure(self, config: MotionConfig) -> None:
        """Use another `stationary_m` from now on."""
        self._config = config

    def reset(self) -> None:
        self._pose: Pose | None = None
        self._edges: Glance | None = None

    def check(self, pose: Pose | None, edges: Glance | None) -> bool:
        """Return whether the robot stands still at a frame, by its pose, or else by its glance."""
        if not self.needs_image(pose):
            return bool(self._by_pose(pose))
        if edges is None or self._edges is None:
            return False
        return distance(edges, self._edges) < self._config.stationary_glance

    def note(self, pose: Pose | None, edges: Glance | None) -> None:
        """Note what is known of the pose and the glance of a frame that moved."""
        self._pose = pose or self._pose
        self._edges = self._edges if edges is None else edges

    def needs_image(self, pose: Pose | None) -> bool:
        """Return whether the image decides, because there is no pose to compare."""
        return self._by_image and self._by_pose(pose) is None

    def _by_pose(self, pose: Pose | None) -> bool | None:
        if pose and self._pose and self._config.stationary_m:
            return near(pose, self._pose, self._config.stationary_m)
        return None


_CLOCK_JUMP_NS = 1_000_000_000  # a frame that is late by more means that the clock jumped

Order = Enum('Order', ['NEXT', 'LATE', 'JUMPED_BACK'])  # of a stamp after the ones before


class StampOrder:
    """Distinguishes frames that come late from a clock that jumped back."""

    _last_ns: int | None = None

    def reset(self) -> None:
        self._last_ns = None

    def check(self, stamp_ns: int) -> Order:
        """Return the order of the next stamp, nanoseconds; a late one is then forgotten."""
        late_ns = 0 if self._last_ns is None else self._last_ns - stamp_ns
        if 0 < late_ns <= _CLOCK_JUMP_NS:
            return Order.LATE
        self._last_ns = stamp_ns
        return Order.JUMPED_BACK if late_ns > 0 else Order.NEXT


class AnyOrder(StampOrder):
    """Treats every frame as the next, whatever its stamp."""

    def check(self, _stamp_ns: int) -> Order:
        """Return NEXT."""
        return Order.NEXT


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
