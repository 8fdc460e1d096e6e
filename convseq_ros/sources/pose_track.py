# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose of the camera at any time, from stamped poses."""

from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import replace
import math
from typing import Any

from convseq_ros.core.rigid import matrix
from convseq_ros.core.types import constants, Pose, ROBOT
import numpy as np

LONGEST_GAP_NS = 1_500_000_000  # poses once a second, and jitter
_FURTHEST_NS = 100_000_000
_CLOCK_JUMP_NS = 1_000_000_000
_NEARLY_PARALLEL = 0.9995
_STEP_M, _LEAST_M = 0.5, 5.0  # of motion that tells its axis
_CONFIRMING = 5  # poses in a row that show a reset of odometry; fewer that come back are outliers


@constants
class EARTH:
    """Where a pose can be."""

    furthest_m: float = 1e8  # beyond any map grid; larger numbers are errors, and overflow


class PoseTrack:
    """
    Poses in order of time, interpolated between neighbours, and extrapolated up to 0.1 s.

    Stamps are nanoseconds, ascending. At least the newest `kept` poses are stored, by default all.
    There is no pose between two that are more than 1.5 s apart. Poses that jump are kept only
    if none of the next few comes back: those of a reset are, outliers are left out. `stamped` are
    the poses of a whole drive: those that jump at its end are left out, too.
    """

    def __init__(self, stamped: Iterable[tuple[int, Pose]] = (), kept: int | None = None) -> None:
        self._kept = kept
        self._stamps: list[int] = []
        self._poses: list[Pose] = []
        self._doubted: list[tuple[int, Pose]] = []
        self.left_out = 0
        for stamp_ns, pose in stamped:
            self.add(stamp_ns, pose)
        self.left_out += len(self._doubted)
        self._doubted.clear()

    @property
    def last_stamp_ns(self) -> int | None:
        """Stamp of the newest pose, nanoseconds; None if there is none."""
        return self._stamps[-1] if self._stamps else None

    @property
    def problem(self) -> str:
        """What was left out so far, in one line; empty if nothing was."""
        if not self.left_out:
            return ''
        jump = f'poses that jump faster than {ROBOT.fastest_mps:g} m/s, and back or at the end,'
        return f'{jump} are left out ({self.left_out}); look at their source'

    def add(self, stamp_ns: int, pose: Pose) -> None:
        """Append a newer pose; if a pose is over a second older, the clock was set back."""
        late_ns = self._stamps[-1] - stamp_ns if self._stamps else -1
        if late_ns > _CLOCK_JUMP_NS:
            self._stamps.clear()
            self._poses.clear()
            self._doubted.clear()
        elif late_ns >= 0:
            return
        for one in self._believed((stamp_ns, pose)):
            self._stamps.append(one[0])
            self._poses.append(one[1])
        if self._kept and len(self._stamps) >= 2 * self._kept:
            del self._stamps[: -self._kept], self._poses[: -self._kept]

    def _believed(self, newest: tuple[int, Pose]) -> list[tuple[int, Pose]]:
        """Return the poses to append after the next one: none, it, or the doubted ones as well."""
        doubted, self._doubted = self._doubted, []
        if not self._is_steady or self._comes_back(doubted, newest):
            self.left_out += len(doubted)
            return [newest]
        doubted = [*(one for one in doubted if one[0] < newest[0]), newest]
        if len(doubted) < _CONFIRMING:
            self._doubted, doubted = doubted, []
        return doubted

    @property
    def _is_steady(self) -> bool:
        """Whether the last step was no jump; after one, poses have no order that one can break."""
        last_two = list(zip(self._stamps[-2:], self._poses[-2:], strict=True))
        return len(last_two) > 1 and not _is_jump(*last_two)

    def _comes_back(self, doubted: list[tuple[int, Pose]], newest: tuple[int, Pose]) -> bool:
        """Return whether a pose continues those that are believed, and not those in doubt."""
        if doubted and not _is_jump(doubted[-1], newest):
            return False
        return not _is_jump((self._stamps[-1], self._poses[-1]), newest)

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


def _is_jump(before: tuple[int, Pose], after: tuple[int, Pose]) -> bool:
    """Return whether no robot moves that far, even if the stamps jitter."""
    duration_s = max(after[0] - before[0], _FURTHEST_NS) / 1e9
    distance_m = math.dist(before[1].position, after[1].position)
    return distance_m > ROBOT.fastest_mps * duration_s


class AxesCheck:
    """Sums up along which of their own axes poses in a row move, in steps of at least 0.5 m."""

    def __init__(self) -> None:
        self._last: Pose | None = None
        self._moved_m = np.zeros(3)

    def add(self, pose: Pose) -> None:
        """Take in the next pose; shivering is no motion."""
        last = self._last = self._last or pose
        if math.dist(pose.position, last.position) >= _STEP_M:
            step = np.subtract(pose.position, last.position)
            self._moved_m += abs(matrix(last)[:3, :3].T @ step)
            self._last = pose

    def problem(self, least_m: float = _LEAST_M) -> str:
        """Return one line if poses move along z, at least so far, as those of a lens; else ''."""
        x, y, z = self._moved_m.tolist()
        if z < max(least_m, x + y):
            return ''
        return (
            f'poses move along their own z ({z:.0f} of {x + y + z:.0f} m), as those of a lens, '
            'and not along x, as those of a robot'
        )


def axes_problem(poses: Iterable[Pose]) -> str:
    """Return the line of `AxesCheck` on all poses of a drive, if there is one."""
    check = AxesCheck()
    for pose in poses:
        check.add(pose)
    return check.problem()


def is_far(position: Iterable[float]) -> bool:
    """Return whether a position is nowhere on Earth, or not finite."""
    return not all(abs(value) <= EARTH.furthest_m for value in position)


def odometry_from_message(message: Any) -> Pose | None:
    """Return the pose of a nav_msgs/Odometry with its variances; None as `pose_from_message`."""
    pose, told = pose_from_message(message.pose.pose), message.pose.covariance
    variances = float(told[0] + told[7]) / 2, float(told[35])
    return pose and replace(pose, variances=variances)


def pose_from_message(pose: Any) -> Pose | None:
    """Return a geometry_msgs/Pose, normalised; None if it is far, or its quaternion no turn."""
    at, turn = pose.position, pose.orientation
    position = (float(at.x), float(at.y), float(at.z))
    orientation = (float(turn.x), float(turn.y), float(turn.z), float(turn.w))
    length = math.hypot(*orientation)
    if is_far(position) or not (math.isfinite(length) and length > 0):
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
    return Pose(tuple(position.tolist()), tuple(turned.tolist()), first.variances)
