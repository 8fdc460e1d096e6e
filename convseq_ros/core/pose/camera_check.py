# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the camera of a drive is on the robot, and whether it is where those of the map were."""

import math

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import angle, as_parameter, inverse, matrix
from convseq_ros.core.types import Camera, constants, Pose
import numpy as np

_NONE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@constants
class MOUNT:
    """By how much two mounts of a camera may differ; engineering."""

    apart_m: float = 0.05
    turned_rad: float = math.radians(2.0)


class CameraCheck:
    """
    What to say about the camera of a drive, once it was seen.

    `note` says where it is, unless who gave the frames knows; `problem` says that it is elsewhere
    than any camera of the map. Both are one line, or empty.
    """

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map
        self._seen: Camera | None = None
        self.note = self.problem = ''

    def see(self, camera: Camera | None, is_mounted: bool) -> None:
        """Take in the upright camera of the next frame, and whether it came with its mount."""
        if camera is None or camera == self._seen:
            return
        self._seen, mount = camera, camera.mount
        self.note = self.problem = ''
        here = f'camera_to_base is "{as_parameter(mount or _NONE)}"'
        theirs = [one.camera.mount for one in self._map.sessions if one.camera]
        known = [one for one in theirs if one]
        if known and not (mount and any(_is_same(mount, one) for one in known)):
            self.problem = (
                f'{here}, and was "{as_parameter(known[-1])}" when the map was made; mend TF or '
                'camera_to_base, unless the camera was moved'
            )
        elif not mount:
            self.note = (
                f'{here}: the base is at the lens, its x along it; set it, or have TF tell, if it '
                'is elsewhere'
            )
        elif not is_mounted:
            self.note = f'{here}, as given'


def _is_same(mount: Pose, other: Pose) -> bool:
    moved = inverse(matrix(mount)) @ matrix(other)
    is_near = float(np.linalg.norm(moved[:3, 3])) <= MOUNT.apart_m
    return is_near and angle(moved[:3, :3]) <= MOUNT.turned_rad
