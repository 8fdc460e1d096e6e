# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulates drifting wheel odometry."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
import math

from convseq_ros.core.types import Pose
from convseq_ros.simulation.drive import Shot
import numpy as np


@dataclass(frozen=True, slots=True)
class Drift:
    """
    The errors of odometry: systematic ones, and random ones that grow with sqrt(distance).

    Two wheels of 300 mm, 0.6 m apart, that differ by 1 mm in size turn a vehicle by 32 degrees in
    100 m.
    """

    scale: float = 0.01  # excess of the measured distance, as a share
    yaw_bias_deg: float = 2.0  # to the left per 100 m
    noise_m: float = 0.02  # after 1 m, both along and across
    yaw_noise_deg: float = 2.0  # after 100 m
    seed: int = 0  # of the random errors


class DriftingOdometer:
    """Measures the motion of a vehicle with drift, from its first pose."""

    def __init__(self, drift: Drift) -> None:
        self._drift = drift
        self._rng = np.random.default_rng(drift.seed)
        self._last: tuple[float, float, float] | None = None
        self._x = self._y = self._yaw = 0.0

    def moved_to(self, pose: Pose) -> Pose:
        """Return the measured pose relative to the first one, from the next true pose."""
        x, y = pose.position[:2]
        yaw = 2 * math.atan2(pose.orientation[2], pose.orientation[3])
        if self._last is not None:
            last_x, last_y, last_yaw = self._last
            cos, sin = math.cos(last_yaw), math.sin(last_yaw)
            ahead = cos * (x - last_x) + sin * (y - last_y)
            aside = cos * (y - last_y) - sin * (x - last_x)
            self._step(ahead, aside, math.remainder(yaw - last_yaw, 2 * math.pi))
        self._last = x, y, yaw
        half = self._yaw / 2
        return Pose((self._x, self._y, 0.0), (0.0, 0.0, math.sin(half), math.cos(half)))

    def lift(self) -> None:
        """Ignore the motion to the next pose, as if the vehicle is carried there."""
        self._last = None

    def _step(self, ahead: float, aside: float, turn: float) -> None:
        drift, distance = self._drift, math.hypot(ahead, aside)
        along, across, turned = self._rng.standard_normal(3) * math.sqrt(distance)
        ahead += drift.scale * ahead + drift.noise_m * along
        aside += drift.scale * aside + drift.noise_m * across
        cos, sin = math.cos(self._yaw), math.sin(self._yaw)
        self._x += cos * ahead - sin * aside
        self._y += sin * ahead + cos * aside
        error_deg = drift.yaw_bias_deg * distance / 100 + drift.yaw_noise_deg * turned / 10
        self._yaw += turn + math.radians(error_deg)


def with_odometry(shots: Iterable[Shot], drift: Drift) -> Iterator[Shot]:
    """Yield the shots with drifting odometry."""
    odometer = DriftingOdometer(drift)
    return (replace(shot, odometry=odometer.moved_to(shot.pose)) for shot in shots)
