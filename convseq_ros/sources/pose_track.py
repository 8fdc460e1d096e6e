# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose of the camera at any time, from stamped poses."""

from bisect import bisect_left
from collections.abc import Iterable
import math
from typing import Any

from convseq_ros.core.types import Pose
import numpy as np

LONGEST_GAP_NS = 1_000_000_000
_FURTHEST_NS = 100_000_000
_CLOCK_JUMP_NS = 1_000_000_000
_NEARLY_PARALLEL = 0.9995


class PoseTrack:
    """
    Poses in order of time, interpolated between neighbours, and extrapolated up to 0.1 s.

    Stamps are nanoseconds, ascending. At least the newest `kept` poses are stored, by default all.
    There is no pose between two that are more than a second apart.
    """

    def __init__(self, stamped: Iterable[tuple[int, Pose]] = (), kept: int | None = None) -> None:
        self._kept = kept
        self._stamps: list[int] = []
        self._poses: list[Pose] = []
        for stamp_ns, pose in stamped:
            self.add(stamp_ns, pose)

    @property
    def last_stamp_ns(self) -> int | None:
        """Stamp of the newest pose, nanoseconds; None if there is none."""
        return self._stamps[-1] if self._stamps else None

    def add(self, stamp_ns: int, pose: Pose) -> None:
        """Append a newer pose; if a pose is over a second older, the clock was set back."""
        late_ns = self._stamps[-1] - stamp_ns if self._stamps else -1
        if late_ns > _CLOCK_JUMP_NS:
            self._stamps.clear()
            self._poses.clear()
        elif late_ns >= 0:
            return
        self._stamps.append(stamp_ns)
        self._poses.append(pose)
        if self._kept and len(self._stamps) >= 2 * self._kept:
            del self._stamps[: -self._kept], self._poses[: -self._kept]

    def at(self, stamp_ns: int) -> Pose | None:
        """Return the pose at a time, up to 0.1 s after the last one; None if it is unknown."""
        after = bisect_left(self._stamps, stamp_ns)
        if after < len(self._stamps) and self._stamps[after] == stamp_ns:
            return self._poses[after]
        if not after or len(self._stamps) < 2 or stamp_ns - self._stamps[-1] > _FURTHEST_NS:
            return None
        after = min(after, len(self._stamps) - 1)
        span_ns = self._stamps[after] - self._stamps[after - 1]
        if span_ns > LONGEST_GAP_NS:
            return None
        share = (stamp_ns - self._stamps[after - 1]) / span_ns
        return _between(self._poses[after - 1], self._poses[after], share)


def pose_from_message(pose: Any) -> Pose | None:
    """Return a geometry_msgs/Pose, normalised; None if it is not finite or its quaternion zero."""
    at, turn = pose.position, pose.orientation
    position = (float(at.x), float(at.y), float(at.z))
    orientation = (float(turn.x), float(turn.y), float(turn.z), float(turn.w))
    length = math.hypot(*orientation)
    if not (all(map(math.isfinite, position)) and math.isfinite(length) and length > 0):
        return None
    if abs(length - 1.0) > 1e-6:
        x, y, z, w = (value / length for value in orientation)
        orientation = (x, y, z, w)
    return Pose(position, orientation)


def _between(first: Pose, second: Pose, share: float) -> Pose:
    """Return the pose at a share of the motion between two; the share may exceed 1."""
    position = (1 - share) * np.array(first.position) + share * np.array(second.position)
    start, end = np.array(first.orientation), np.array(second.orientation)
    cosine = float(start @ end)
    if cosine < 0:
        cosine, end = -cosine, -end
    if cosine > _NEARLY_PARALLEL:
        turned = (1 - share) * start + share * end
    else:
        angle = math.acos(cosine)
        turned = math.sin((1 - share) * angle) * start + math.sin(share * angle) * end
    turned /= np.linalg.norm(turned)
    return Pose(tuple(position.tolist()), tuple(turned.tolist()))
