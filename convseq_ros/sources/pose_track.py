# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the camera was at any time: stamped poses of a stream, or of a file (TUM, KITTI)."""

from bisect import bisect_left
from collections.abc import Callable, Iterable
from decimal import Decimal
import math
from pathlib import Path
from typing import Any

from convseq_ros.core.rigid import quaternion, ROBOT_LENS
from convseq_ros.core.types import Pose
from convseq_ros.errors import SourceError
from convseq_ros.files import read_text
from convseq_ros.reading_config import ReadingConfig
import numpy as np
import numpy.typing as npt

PoseAt = Callable[[int, int], Pose | None]  # from a frame's number and stamp in nanoseconds
LONGEST_GAP_NS = 1_000_000_000
_FURTHEST_NS = 100_000_000
_CLOCK_JUMP_NS = 1_000_000_000
_NEARLY_PARALLEL = 0.9995


class PoseTrack:
    """
    Poses in order of time, interpolated between neighbours, and a little beyond the last.

    Stamps are nanoseconds, ascending. The newest `kept` are remembered, by default all. Between
    two poses that are further apart than `longest_gap_ns`, by default a second, there are none.
    """

    def __init__(
        self,
        stamped: Iterable[tuple[int, Pose]] = (),
        kept: int | None = None,
        longest_gap_ns: int | None = None,
    ) -> None:
        self._kept, self._longest_gap_ns = kept, longest_gap_ns or LONGEST_GAP_NS
        self._stamps: list[int] = []
        self._poses: list[Pose] = []
        for stamp_ns, pose in stamped:
            self.add(stamp_ns, pose)

    @property
    def last_stamp_ns(self) -> int | None:
        """Stamp of the newest pose, nanoseconds; None if there is none."""
        return self._stamps[-1] if self._stamps else None

    def add(self, stamp_ns: int, pose: Pose) -> None:
        """
        Append a pose.

        One that is no newer than the last is left out; one that is older by over a second is a
        jump of the clock, before which all is forgotten.
        """
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
        """
        Return the pose at a time.

        None before the first, in a gap that is too long, and later than a tenth of a second after
        the last; until then, the last two go on as they were.
        """
        after = bisect_left(self._stamps, stamp_ns)
        if after < len(self._stamps) and self._stamps[after] == stamp_ns:
            return self._poses[after]
        if not after or (after == len(self._stamps) and self._too_late(stamp_ns)):
            return None
        after = min(after, len(self._stamps) - 1)
        span_ns = self._stamps[after] - self._stamps[after - 1]
        if span_ns > self._longest_gap_ns:
            return None
        share = (stamp_ns - self._stamps[after - 1]) / span_ns
        return _between(self._poses[after - 1], self._poses[after], share)

    def _too_late(self, stamp_ns: int) -> bool:
        return len(self._stamps) < 2 or stamp_ns - self._stamps[-1] > _FURTHEST_NS


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
    """Return the pose at a share of the way, which may be more than 1."""
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


_TUM, _KITTI = 8, 12  # numbers in a line
# KITTI's axes are those of a lens (x right, y down, z ahead), ours those of a robot (REP-103: x
# ahead, y left, z up).
_TO_ROBOT = ROBOT_LENS[:3, :3]
_ROTATION_ERROR = 1e-3  # of a product of axes; files have six digits


def read_pose_file(path: Path, frames: int, reading: ReadingConfig = ReadingConfig()) -> PoseAt:
    """
    Return the poses of a file, one a line; empty lines and those that begin with # are left out.

    A line of 8 numbers is TUM's: the stamp in seconds, position, quaternion x, y, z, w; poses are
    taken as they are, and frames between two stamps lie between their poses. A line of 12 is
    KITTI's, one for each of the `frames`: the 3 x 4 matrix of the camera, rows first, in the order
    of the frames; its axes, those of a lens, become those of a robot. SourceError if the file
    cannot be read, is neither, a line is not a pose, or there are not as many.
    """
    text = read_text(path, 'a text file of poses, one a line', reading)
    lines = [(number, line.split()) for number, line in enumerate(text.splitlines(), 1)]
    rows = [(number, words) for number, words in lines if words and not words[0].startswith('#')]
    if not rows:
        raise SourceError(f'{path}: holds no pose; give one a line')
    size, stamped = len(rows[0][1]), list[tuple[int, Pose]]()
    for number, words in rows:
        if len(words) != size or size not in (_TUM, _KITTI):
            raise SourceError(
                f'{path}, line {number}: {len(words)} numbers; expected {_TUM} (TUM: stamp, '
                f'position, quaternion) or {_KITTI} (KITTI: a 3 x 4 matrix) in every line'
            )
        try:
            stamped.append(_tum(words) if size == _TUM else (number, _kitti(words)))
        except ValueError as error:
            raise SourceError(f'{path}, line {number}: {str(error)[:200]}') from None
    if size == _TUM:
        track = PoseTrack(sorted(stamped, key=lambda one: one[0]))
        return lambda _index, stamp_ns: track.at(stamp_ns)
    if len(rows) != frames:
        raise SourceError(
            f"{path}: {len(rows)} poses for {frames} images; KITTI's format has one for each"
        )
    return lambda index, _stamp_ns: stamped[index][1]


def _numbers(words: list[str]) -> npt.NDArray[np.float64]:
    numbers = np.array([float(word) for word in words])
    if not np.isfinite(numbers).all():
        raise ValueError('a number is not finite; leave the line out')
    return numbers


def _tum(words: list[str]) -> tuple[int, Pose]:
    """Return a stamp in nanoseconds, exact where a double would round it, and the pose."""
    try:
        stamp = Decimal(words[0]) * 1_000_000_000
        is_stamp = 0 <= stamp < 2**63
    except ArithmeticError:
        is_stamp = False
    if not is_stamp:
        raise ValueError(f'{words[0][:80]} is no stamp in seconds')
    x, y, z, *turn = _numbers(words[1:]).tolist()
    length = math.hypot(*turn)
    if not length:
        raise ValueError('the quaternion is zero; leave the line out')
    qx, qy, qz, qw = (value / length for value in turn)
    return int(stamp), Pose((x, y, z), (qx, qy, qz, qw))


def _kitti(words: list[str]) -> Pose:
    matrix = _numbers(words).reshape(3, 4)
    rotation = _TO_ROBOT @ matrix[:, :3] @ _TO_ROBOT.T
    error = abs(rotation @ rotation.T - np.eye(3)).max()
    if error > _ROTATION_ERROR or np.linalg.det(rotation) < 0:
        raise ValueError('its first three columns are not a rotation')
    x, y, z = (_TO_ROBOT @ matrix[:, 3]).tolist()
    return Pose((x, y, z), quaternion(rotation))
