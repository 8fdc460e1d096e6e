# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the robot that carries the camera; written once, as in `config`."""

from dataclasses import dataclass, replace
import math

from convseq_ros.errors import ConfigError
from convseq_ros.parameter import Checked, parameter

_UNKNOWN = '0 0 0 0 0 0'


# fmt: off
@dataclass(frozen=True, slots=True)
class RobotConfig(Checked):
    """Where the camera is on the robot, and how far odometry is believed."""

    camera_to_base: str = parameter(
        _UNKNOWN, 'Where the upright camera is in base_frame: x y z in metres, roll pitch '
        'yaw in radians; x ahead, along the lens, y left, z up; of several cameras one after the '
        'other, with semicolons between. The node prefers TF.',
    )
    odometry_way_error: float = parameter(
        0.1, 'Odometry is off by at most this share of the way; a match that contradicts it by '
        'more is implausible. 0 believes every match.', low=0.0, high=10.0,
    )
    odometry_turn_error: float = parameter(
        0.05, 'Odometry is off by at most this share of what the robot turns, in addition.',
        low=0.0, high=10.0,
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if not all(map(_numbers, self.camera_to_base.split(';'))):
            raise ConfigError(
                f'camera_to_base: {self.camera_to_base!r} is not six numbers: x y z in metres, '
                'roll pitch yaw in radians; between several cameras a semicolon'
            )

    @property
    def mount(self) -> tuple[float, ...]:
        """The numbers of camera_to_base, six, of the first camera."""
        return _numbers(self.camera_to_base.split(';')[0])

    def of_camera(self, number: int) -> 'RobotConfig':
        """Return what holds of a camera by its number; one that is not told of has zeros."""
        told = self.camera_to_base.split(';')
        return replace(self, camera_to_base=told[number] if number < len(told) else _UNKNOWN)


def _numbers(text: str) -> tuple[float, ...]:
    """Return six numbers; none if they are not."""
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        return ()
    return numbers if len(numbers) == 6 and all(map(math.isfinite, numbers)) else ()
