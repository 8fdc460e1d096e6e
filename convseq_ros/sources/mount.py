# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where cameras and odometry are on a robot, by TF: the same for the node and for recordings."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
import math
from types import SimpleNamespace
from typing import Any

from convseq_ros.core.rigid import as_parameter as as_parameter
from convseq_ros.core.rigid import inverse, Matrix, matrix, pose_of, ROBOT_LENS
from convseq_ros.core.types import Pose
from convseq_ros.sources.pose_track import pose_from_message
import numpy as np

_UP = math.cos(math.radians(20))  # of the angle between straight up and a lens that looks there
# Names of the robot itself (REP-105, REP-120), which differ by the height of its wheels.
_BODIES = 'base', 'base_link', 'base_footprint'


@dataclass(frozen=True, slots=True)
class Tf:
    """How TF of a recording is used."""

    base_frame: str = 'base_link'
    camera_to_base: str = ''  # what was given instead, which wins; else empty
    tell: Callable[[str], None] = lambda _line: None  # gets a line that says which was used


def pose_of_transform(transform: Any) -> Pose | None:
    """Return a geometry_msgs/Transform as a pose; None if it is not finite."""
    parts = {'position': transform.translation, 'orientation': transform.rotation}
    return pose_from_message(SimpleNamespace(**parts))


def mount_of(lens: Pose) -> Pose:
    """Return the mount of a camera, x along its lens, from the pose of its optical frame."""
    return pose_of(matrix(lens) @ inverse(ROBOT_LENS))


def told_mount(lens: Pose, frame: str, base_frame: str, by: str) -> tuple[Pose | None, str]:
    """Return the mount of a lens frame, None if its z is up as of a body, and a line on it."""
    if matrix(lens)[2, 2] >= _UP:
        return None, (
            f'{frame} is no optical frame, whose z is ahead: the lens would look straight up, so '
            'it is not used; give camera_info the optical frame, or set camera_to_base'
        )
    mount = mount_of(lens)
    at = as_parameter(mount)
    return mount, f'camera_to_base is "{at}", as {by} places {frame} in {base_frame}'


class StaticTransforms:
    """The frames of /tf_static; where several messages place a frame, the last one counts."""

    def __init__(self, messages: Iterable[Any]) -> None:
        self._above: dict[str, tuple[str, Matrix]] = {}
        for message in messages:
            for stamped in message.transforms:
                pose = pose_of_transform(stamped.transform)
                if pose is not None:
                    frames = (
                        plain_frame(stamped.child_frame_id),
                        plain_frame(stamped.header.frame_id),
                    )
                    self._above[frames[0]] = frames[1], matrix(pose)

    def pose_in(self, base: str, frame: str) -> Pose | None:
        """Return the pose of a frame in another; None if no transforms lead there."""
        above, found = self._to_root(plain_frame(base)), self._to_root(plain_frame(frame))
        common = next((name for name in found if name in above), None)
        if common is None:
            return None
        return pose_of(inverse(above[common]) @ found[common])

    def _to_root(self, frame: str) -> dict[str, Matrix]:
        """Return the pose of a frame in itself and in each frame above it."""
        poses = {frame: np.eye(4)}
        moved = poses[frame]
        while frame in self._above:
            frame, step = self._above[frame]
            if frame in poses:  # a circle
                break
            moved = step @ moved
            poses[frame] = moved
        return poses


class OdometryFrame:
    """
    Carries poses of odometry from their `child_frame_id` to the base.

    `base_in` returns the pose of the base in a frame, None if static TF has no way there; `tell`
    gets a line for each frame from which poses are carried.
    """

    def __init__(
        self,
        base_frame: str,
        base_in: Callable[[str], Pose | None],
        tell: Callable[[str], None] = lambda _line: None,
    ) -> None:
        self._base, self._base_in, self._tell = plain_frame(base_frame), base_in, tell
        self._known: dict[str, Matrix] = {}

    def carried(self, pose: Pose, child_frame: str) -> Pose | None:
        """Return the pose of the base; None if it is unknown where the frame is on the robot."""
        child = plain_frame(child_frame)
        if child in ('', self._base):
            return pose
        if child not in self._known and (base := self._base_in(child)):
            self._known[child] = matrix(base)
            self._tell(f'poses of {child} are carried to {self._base} by static TF')
        if child in self._known:
            carried = pose_of(matrix(pose) @ self._known[child])
            return replace(carried, variances=pose.variances)
        return pose if child.rpartition('/')[2] in _BODIES else None

    def problem(self, child_frame: str) -> str:
        """Return a line for poses that cannot be carried."""
        return (
            f'poses are of {plain_frame(child_frame)}, and static TF has no way from it to '
            f'{self._base}: they are left out; publish or record it, or name another base_frame'
        )


def plain_frame(frame: str) -> str:
    """Return the name of a frame without the slash of ROS 1."""
    return frame.removeprefix('/')
