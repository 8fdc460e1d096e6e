# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the robot; written once, as in `config`."""

from dataclasses import dataclass, replace
import math

from convseq_ros.config.parameter import Checked, parameter
from convseq_ros.errors import ConfigError

_UNKNOWN_MOUNT = '0 0 0 0 0 0'


# fmt: off
@dataclass(frozen=True, slots=True)
class RobotConfig(Checked):
    """Where the camera is on the robot, and how far odometry is trusted."""

    camera_to_base: str = parameter(
        _UNKNOWN_MOUNT, 'Pose of the upright camera in base_frame: x y z in metres, roll pitch '
        'yaw in radians, x along the lens, y left, z up; a semicolon between several cameras. The '
        'node prefers TF, commands prefer this to TF.',
        dynamic=True,
    )
    odometry_way_error: float = parameter(
        0.1, 'Largest error of odometry as a fraction of the distance; places beyond it get less '
        'probability; 0 leaves odometry out.',
        low=0.0, high=10.0,
    )
    odometry_turn_error: float = 0.05  # in addition, as a fraction of the angle turned

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if not all(map(_numbers, self.camera_to_base.split(';'))):
            raise ConfigError(
                f'camera_to_base: {self.camera_to_base!r} is not six numbers: x y z in metres, '
                'roll pitch yaw in radians; between several cameras a semicolon'
            )

    @property
    def mount(self) -> tuple[float, ...]:
        """The six numbers of camera_to_base for the first camera."""
        return _numbers(self.camera_to_base.split(';')[0])

    def refuse_count(self, cameras: int) -> None:
        """Raise a ConfigError if poses are given, but not one for each camera."""
        count = self.camera_to_base.count(';') + 1
        if self.camera_to_base != _UNKNOWN_MOUNT and count != cameras:
            raise ConfigError(
                f'camera_to_base: {count} pose(s) for {cameras} camera(s); give one for each, '
                'with a semicolon between'
            )

    def of_camera(self, number: int) -> 'RobotConfig':
        """Return the settings of camera `number`; its pose is zeros if none is given."""
        mounts = self.camera_to_base.split(';')
        mount = mounts[number] if number < len(mounts) else _UNKNOWN_MOUNT
        return replace(self, camera_to_base=mount)


def _numbers(text: str) -> tuple[float, ...]:
    """Return the six numbers of a text; an empty tuple if it does not hold six."""
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        return ()
    return numbers if len(numbers) == 6 and all(map(math.isfinite, numbers)) else ()
