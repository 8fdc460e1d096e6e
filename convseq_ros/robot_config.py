# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the robot that carries the camera; written once, as in `config`."""

from dataclasses import dataclass
import math

from convseq_ros.errors import ConfigError
from convseq_ros.parameter import Checked, parameter


# fmt: off
@dataclass(frozen=True, slots=True)
class RobotConfig(Checked):
    """Where the camera is on the robot, and how far odometry is believed."""

    camera_to_base: str = parameter(
        '0 0 0 0 0 0', 'Where the upright camera is in base_frame: x y z in metres, roll pitch '
        'yaw in radians; x ahead, along the lens, y left, z up. The node prefers TF.',
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
        if len(self.mount) != 6:
            raise ConfigError(
                f'camera_to_base: {self.camera_to_base!r} is not six numbers: x y z in metres, '
                'roll pitch yaw in radians'
            )

    @property
    def mount(self) -> tuple[float, ...]:
        """The numbers of camera_to_base; none if they are no numbers."""
        try:
            numbers = tuple(float(word) for word in self.camera_to_base.split())
        except ValueError:
            return ()
        return numbers if all(map(math.isfinite, numbers)) else ()
