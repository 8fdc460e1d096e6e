# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drawn town that is mapped by day, and a robot that is put down in it three times at night."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from convseq_ros.simulation.drive import draw, Drive, Shot
from convseq_ros.simulation.odometry import Drift, Odometer
from convseq_ros.simulation.recording import write_recording
from convseq_ros.simulation.route import Route

DRIFT = Drift(scale=0.015, yaw_bias_deg=3.0, noise_m=0.02, yaw_noise_deg=3.0, seed=3)
_INFO = '/camera/camera_info'
_STEP_NS, _LATER_NS = 100_000_000, 12 * 3600 * 10**9
_SIZE = {'width_px': 320, 'height_px': 240}


@dataclass(frozen=True, slots=True)
class Stay:
    """Where the robot is put down, and how."""

    start_m: float  # along the mapped way
    lane_offset_m: float  # the map was made at -1
    heading_deg: float  # turned to the left of the way
    frames: int = 32


STAYS = (Stay(205.0, -1.8, 0.0), Stay(62.0, 0.2, 6.0), Stay(330.0, -2.2, -8.0))


def town() -> Route:
    """Return a way of some 460 m."""
    corners = ((0, 0), (120, 0), (120, 80), (0, 80), (0, 160), (120, 160))
    return Route(tuple((float(x), float(y)) for x, y in corners), seed=11)


def record_day(path: Path, step_m: float) -> None:
    """Write the drive that is mapped."""
    route = town()
    frames = int((route.length_m - 1) / step_m)
    day = Drive(num_frames=frames, speed_mps=10 * step_m, lane_offset_m=-1.0, **_SIZE)
    write_recording(path, draw(route, day), info_topic=_INFO)


def record_night(path: Path, stays: Sequence[Stay] = STAYS) -> list[tuple[int, Shot]]:
    """Write the drive at night; return each frame with the number of its stay."""
    shots = list(_night(stays))
    write_recording(path, (shot for _, shot in shots), info_topic=_INFO)
    return shots


def _night(stays: Sequence[Stay]) -> Iterator[tuple[int, Shot]]:
    """Yield the frames of all stays; the odometry knows nothing of being carried."""
    route, odometer, clock = town(), Odometer(DRIFT), count()
    for number, stay in enumerate(stays):
        drive = Drive(
            start_m=stay.start_m,
            num_frames=stay.frames,
            lane_offset_m=stay.lane_offset_m,
            heading_deg=stay.heading_deg,
            light='night',
            noise=4.0,
            seed=number + 5,
            **_SIZE,
        )
        odometer.lift()
        for shot in draw(route, drive):
            stamp_ns = drive.start_ns + _LATER_NS + next(clock) * _STEP_NS
            believed = odometer.moved_to(shot.pose)
            yield number, replace(shot, stamp_ns=stamp_ns, odometry=believed)
