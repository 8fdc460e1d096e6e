# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses from text in the format of TUM or KITTI: one file, or one a frame."""

from collections.abc import Callable, Iterator
from decimal import Decimal
import math
from pathlib import Path
import re

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.rigid import matrix, pose_of, quaternion, ROBOT_LENS
from convseq_ros.core.types import Pose
from convseq_ros.errors import SourceError
from convseq_ros.io.files import read_text
from convseq_ros.sources.folder import natural_key
from convseq_ros.sources.pose_track import axes_problem, EARTH, is_far, PoseTrack
import numpy as np
import numpy.typing as npt

PoseAt = Callable[[int, int], Pose | None]  # from a frame's number and stamp in nanoseconds
_TUM, _KITTI = (8, 9), (12, 16)  # numbers per line
_NUMBER = re.compile(r'(?<!\w)[-+.]?(?:[0-9]|inf|nan)')
_W_FIRST = re.compile(r'\bq\w*w\b.*\bq\w*x\b', re.IGNORECASE)  # of EuRoC, COLMAP, AirSim
_CONVERTERS = 'evo_traj converts EuRoC, docs/FILES.md shows how AirSim and NeRF'
_CHOICE = '--pose-axes lens converts them, --pose-axes robot takes them as they are'
_MILLISECONDS = 10**12  # since 1970, or finer units, are stamps from here on
# KITTI uses the axes of a lens (x right, y down, z ahead), ROS those of a robot (REP-103: x ahead,
# y left, z up).
_TO_ROBOT = ROBOT_LENS[:3, :3]
_ROTATION_ERROR = 1e-3  # maximum error of a product of axes; files have six digits


def read_pose_file(
    path: Path,
    frames: int,
    reading: ReadingConfig = ReadingConfig(),
    warnings: list[str] | None = None,
    axes: str = '',
) -> PoseAt:
    """
    Return a function that gives a frame's pose from a file with one pose per line; or SourceError.

    A line of 8 numbers is TUM's: stamp in seconds, position, quaternion; poses are interpolated
    between two stamps. A stamp of 10^12 or more is in milli-, micro- or nanoseconds since 1970; a
    ninth number is RTAB-Map's, and left out. A line of 12 numbers is KITTI's: the 3 x 4 matrix of
    the camera, one for each of the `frames`, or of 16 with a fourth row; its axes are converted
    from those of a lens to those of a robot. A folder has a text file with one matrix for each
    frame (7-Scenes). Numbers have blanks or commas between. `warnings` gets the line of
    `PoseTrack.problem`, if there is one.

    TUM's poses are in `axes` of a 'robot', or of a 'lens', which are converted. If nobody says so,
    poses that move along their own z are refused.
    """
    rows = list(_rows(path, reading))
    if not rows:
        raise SourceError(f'{path}: holds no pose; give one per line')
    size, stamped = len(rows[0][1]), list[tuple[int, Pose]]()
    for number, (where, words) in enumerate(rows):
        if len(words) != size or size not in (*_TUM, *_KITTI):
            raise SourceError(
                f'{where}: {len(words)} numbers; expected {_TUM[0]} (TUM: stamp, position, '
                f'quaternion) or {_KITTI[0]} (KITTI: a 3 x 4 matrix) in every line; {_CONVERTERS}'
            )
        try:
            stamped.append(_tum(words) if size in _TUM else (number, _kitti(words[:12])))
        except ValueError as error:
            raise SourceError(f'{where}: {str(error)[:200]}') from None
    if size in _TUM:
        if axes == 'lens':
            stamped = _of_robot(stamped)
        elif not axes and (line := axes_problem(pose for _, pose in stamped)):
            raise SourceError(f'{path}: {line}; {_CHOICE}')
        track = PoseTrack(sorted(stamped, key=lambda item: item[0]))
        if track.problem and warnings is not None:
            warnings.append(f'{path}: {track.problem}')
        return lambda _index, stamp_ns: track.at(stamp_ns)
    if len(rows) != frames:
        raise SourceError(
            f"{path}: {len(rows)} poses for {frames} images; KITTI's format has one for each"
        )
    return lambda index, _stamp_ns: stamped[index][1]


def _rows(path: Path, reading: ReadingConfig) -> Iterator[tuple[str, list[str]]]:
    """Yield where each pose stands, and its words; SourceError if a heading has another order."""
    if path.is_dir():
        for file in sorted(path.glob('*.txt'), key=natural_key):
            yield str(file), read_text(file, 'a pose', reading).replace(',', ' ').split()
        return
    text = read_text(path, 'a text file with one pose per line', reading)
    for number, line in enumerate(text.splitlines(), 1):
        words, where = line.replace(',', ' ').split(), f'{path}, line {number}'
        if line.lstrip().startswith('#') or not _NUMBER.search(line):
            if _W_FIRST.search(line):
                raise SourceError(
                    f'{where}: its quaternions begin with w; TUM has x y z w: {_CONVERTERS}'
                )
        elif words:
            yield where, words


def _numbers(words: list[str]) -> npt.NDArray[np.float64]:
    numbers = np.array([float(word) for word in words])
    if not np.isfinite(numbers).all():
        raise ValueError('a number is not finite; leave the line out')
    return numbers


def _refuse_far(*position: float) -> None:
    if is_far(position):
        furthest = max(position, key=abs)
        raise ValueError(
            f'a position of {furthest:g} m is beyond {EARTH.furthest_m:g} m; leave the line out'
        )


def _tum(words: list[str]) -> tuple[int, Pose]:
    """Return a stamp in nanoseconds, exact where a double would round it, and the pose."""
    try:
        stamp = Decimal(words[0])
        for _ in 'milli', 'micro', 'nano':
            stamp = stamp / 1000 if stamp >= _MILLISECONDS else stamp
        stamp *= 1_000_000_000
        is_stamp = 0 <= stamp < 2**63
    except ArithmeticError:
        is_stamp = False
    if not is_stamp:
        raise ValueError(f'{words[0][:80]} is not a stamp in seconds')
    x, y, z, *turn = _numbers(words[1:])[:7].tolist()
    _refuse_far(x, y, z)
    length = math.hypot(*turn)
    if not length:
        raise ValueError('the quaternion is zero; leave the line out')
    qx, qy, qz, qw = (value / length for value in turn)
    return int(stamp), Pose((x, y, z), (qx, qy, qz, qw))


def _of_robot(stamped: list[tuple[int, Pose]]) -> list[tuple[int, Pose]]:
    """Return poses of a lens as those of a robot; the z of their world points up, or ahead."""
    lenses = [matrix(pose) for _, pose in stamped]
    up = -np.mean([lens[:3, 1] for lens in lenses], axis=0)  # the lens is upright on the whole
    world = np.eye(4) if up[2] > -up[1] else ROBOT_LENS
    turned = (pose_of(world @ lens @ ROBOT_LENS.T) for lens in lenses)
    return [(stamp_ns, pose) for (stamp_ns, _), pose in zip(stamped, turned, strict=True)]


def _kitti(words: list[str]) -> Pose:
    matrix = _numbers(words).reshape(3, 4)
    rotation = _TO_ROBOT @ matrix[:, :3] @ _TO_ROBOT.T
    error = abs(rotation @ rotation.T - np.eye(3)).max()
    if error > _ROTATION_ERROR or np.linalg.det(rotation) < 0:
        raise ValueError('its first three columns are not a rotation')
    x, y, z = (_TO_ROBOT @ matrix[:, 3]).tolist()
    _refuse_far(x, y, z)
    return Pose((x, y, z), quaternion(rotation))
