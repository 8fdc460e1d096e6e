# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses from satellite fixes: metres east and north of an origin that names their frame."""

from collections.abc import Iterable, Sequence
import math
from typing import Any, NamedTuple

from convseq_ros.core.types import Pose
import numpy as np
import numpy.typing as npt

_EQUATOR_M, _FLATTENING = 6378137.0, 1 / 298.257223563  # WGS 84, NIMA TR8350.2
_DECIMALS = 1  # of the origin's degrees, so that drives of a region share it; at most 8 km away
FIXES_GAP_NS = 3_000_000_000  # largest gap between fixes that is interpolated; they come at 1 Hz
_LEAST_WAY_M = 1.0  # between two fixes that give the heading; fixes scatter


class Fix(NamedTuple):
    """Where a receiver was."""

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float  # over the ellipsoid; 0 if unknown


def fix_from_message(stamp_ns: int, message: Any) -> Fix | None:
    """Return the fix of a sensor_msgs/NavSatFix; None if it has none, or an impossible one."""
    latitude, longitude = float(message.latitude), float(message.longitude)
    if message.status.status < 0 or not (abs(latitude) <= 90 and abs(longitude) <= 180):
        return None
    altitude = float(message.altitude)
    return Fix(stamp_ns, latitude, longitude, altitude if math.isfinite(altitude) else 0.0)


def local_poses(fixes: Sequence[Fix]) -> tuple[list[tuple[int, Pose]], str]:
    """
    Return poses by time, x to the east, y to the north, z up, and the name of their frame.

    The origin is the first fix with its degrees rounded to tenths. It names the frame, so drives
    in one region share a frame. The heading is the direction of the last movement.
    """
    if not fixes:
        return [], ''
    latitude, longitude = (round(degrees, _DECIMALS) + 0.0 for degrees in fixes[0][1:3])
    origin, axes = _in_space(latitude, longitude, 0.0), _axes(latitude, longitude)
    local = [axes @ (_in_space(*fix[1:]) - origin) for fix in fixes]
    poses = [
        (fix.stamp_ns, Pose((x, y, z), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))))
        for fix, (x, y, z), yaw in zip(fixes, np.array(local).tolist(), _yaws(local), strict=True)
    ]
    return poses, f'ENU {latitude:.{_DECIMALS}f} {longitude:.{_DECIMALS}f}'


def _in_space(latitude: float, longitude: float, height_m: float) -> npt.NDArray[np.float64]:
    """Return the position (3,) of a place on Earth, in metres from its centre."""
    sine, cosine = math.sin(math.radians(latitude)), math.cos(math.radians(latitude))
    squared = _FLATTENING * (2 - _FLATTENING)
    radius = _EQUATOR_M / math.sqrt(1 - squared * sine**2)
    east = math.radians(longitude)
    return np.array(
        (
            (radius + height_m) * cosine * math.cos(east),
            (radius + height_m) * cosine * math.sin(east),
            (radius * (1 - squared) + height_m) * sine,
        )
    )


def _axes(latitude: float, longitude: float) -> npt.NDArray[np.float64]:
    """Return the directions east, north and up as rows (3, 3)."""
    north, east = math.radians(latitude), math.radians(longitude)
    up = (math.cos(north) * math.cos(east), math.cos(north) * math.sin(east), math.sin(north))
    to_east = (-math.sin(east), math.cos(east), 0.0)
    return np.array((to_east, np.cross(up, to_east), up))


def _yaws(points: Iterable[npt.NDArray[np.float64]]) -> list[float]:
    """Return the heading at each point, in radians counter-clockwise from the east."""
    headings: list[float | None] = []
    last: npt.NDArray[np.float64] | None = None
    heading: float | None = None
    for point in points:
        if last is None or math.hypot(*(point - last)[:2]) >= _LEAST_WAY_M:
            if last is not None:
                heading = math.atan2(point[1] - last[1], point[0] - last[0])
            last = point
        headings.append(heading)
    first = next((heading for heading in headings if heading is not None), 0.0)
    return [first if heading is None else heading for heading in headings]
