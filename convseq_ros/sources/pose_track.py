# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the camera was at any time, from the poses of a recording."""

from bisect import bisect_left
from collections.abc import Sequence

from convseq_ros.core.types import Pose
import numpy as np

_LONGEST_GAP_NS = 1_000_000_000


class PoseTrack:
    """
    Poses in order of time, interpolated between neighbours.

    Parameters
    ----------
    stamped : sequence of (int, Pose)
        Stamps in nanoseconds, ascending.

    """

    def __init__(self, stamped: Sequence[tuple[int, Pose]]) -> None:
        self._stamps = [stamp for stamp, _ in stamped]
        self._poses = [pose for _, pose in stamped]

    def at(self, stamp_ns: int) -> Pose | None:
        """Return the pose at a time; None before, after, or in a gap of over a second."""
        after = bisect_left(self._stamps, stamp_ns)
        if after < len(self._stamps) and self._stamps[after] == stamp_ns:
            return self._poses[after]
        if not 0 < after < len(self._stamps):
            return None
        span_ns = self._stamps[after] - self._stamps[after - 1]
        if span_ns > _LONGEST_GAP_NS:
            return None
        share = (stamp_ns - self._stamps[after - 1]) / span_ns
        return _between(self._poses[after - 1], self._poses[after], share)


def _between(first: Pose, second: Pose, share: float) -> Pose:
    position = (1 - share) * np.array(first.position) + share * np.array(second.position)
    start, end = np.array(first.orientation), np.array(second.orientation)
    turned = (1 - share) * start + share * (end if start @ end >= 0 else -end)
    turned /= np.linalg.norm(turned)
    return Pose(tuple(position.tolist()), tuple(turned.tolist()))
