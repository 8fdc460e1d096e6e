# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the frames of a drive along a street or a route, with the true pose of each frame."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
import math
from typing import Protocol

from convseq_ros.core.types import Camera, Frame, Pose
from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.light import Image, LIGHTS
from convseq_ros.simulation.street import Spot, Street
from convseq_ros.simulation.view import View
import cv2
import numpy as np

_SLOPE_M = 0.5
_MOST_VIEWS = 2


class Road(Protocol):
    """A street, or a route through a town."""

    @property
    def length_m(self) -> float:
        """The drivable length."""

    def spot(self, distance_m: float, offset_m: float, yaw_rad: float) -> Spot:
        """Return the spot at a distance, an offset to the left and a yaw against the road."""


@dataclass(frozen=True, slots=True)
class Drive:
    """How a street or a route is driven; angles are positive to the left."""

    start_m: float = 0.0  # along the road, where the first frame is taken
    speed_mps: float = 10.0  # 0 stands still, negative speeds drive towards the beginning
    frame_rate_hz: float = 10.0
    num_frames: int = 150
    # To the left of the middle of the street, seen along the street, in both driving directions.
    # The right lane is at -1.5, the opposite lane at 1.5.
    lane_offset_m: float = -1.5
    # Replaces `lane_offset_m`: ascending distances in metres, each with its offset. The vehicle
    # drives in straight lines between them.
    lanes: tuple[tuple[float, float], ...] = ()
    heading_deg: float = 0.0  # of the vehicle against the street; 180 faces backwards
    camera_yaw_deg: float = 0.0  # of the camera on the vehicle; 180 looks backwards
    light: str = 'day'  # or 'overcast', 'evening', 'night'
    brightness: float = 1.0  # exposure of the camera
    noise: float = 0.0  # standard deviation in grey levels, added to the noise of the light
    seed: int = 0  # of the noise
    start_ns: int = 1_700_000_000_000_000_000  # stamp of the first frame
    width_px: int = 640
    height_px: int = 480
    field_of_view_deg: float = 80.0  # horizontal

    def __post_init__(self) -> None:
        if self.light not in LIGHTS:
            raise ConvseqError(f'light: {self.light!r} is not one of {", ".join(LIGHTS)}')
        for name in ('frame_rate_hz', 'width_px', 'height_px'):
            if not getattr(self, name) > 0:
                raise ConvseqError(f'{name}: {getattr(self, name)} is not positive')
        if not math.isfinite(self.speed_mps):
            raise ConvseqError(f'speed_mps: {self.speed_mps} is no speed')
        for name in ('start_m', 'num_frames', 'brightness', 'noise', 'seed'):
            if not getattr(self, name) >= 0:
                raise ConvseqError(f'{name}: {getattr(self, name)} is negative')
        offsets = ('lane_offset_m', self.lane_offset_m), *(('lanes', at) for _, at in self.lanes)
        for name, offset in offsets:
            if not abs(offset) <= 3.0:
                raise ConvseqError(f'{name}: {offset} is off the lanes; stay within -3 .. 3')
        if any(not a[0] < b[0] for a, b in pairwise(self.lanes)):
            raise ConvseqError(f'lanes: the distances of {self.lanes} do not ascend')
        if not 20 <= self.field_of_view_deg <= 140:
            raise ConvseqError(f'field_of_view_deg: {self.field_of_view_deg} is outside 20 .. 140')

    @property
    def camera(self) -> Camera:
        focal = self.width_px / 2 / math.tan(math.radians(self.field_of_view_deg) / 2)
        middle = self.width_px / 2, self.height_px / 2
        yaw_rad = math.radians(self.camera_yaw_deg)
        mount = _pose(0.0, 0.0, yaw_rad) if yaw_rad else None
        return Camera(self.width_px, self.height_px, focal, focal, *middle, mount=mount)

    def distance_m(self, index: int) -> float:
        """Return the distance along the road at a frame."""
        return self.start_m + self.speed_mps * index / self.frame_rate_hz

    def offset_m(self, distance_m: float) -> float:
        """Return the offset to the left of the middle at a distance."""
        if not self.lanes:
            return self.lane_offset_m
        at, offsets = zip(*self.lanes, strict=True)
        return float(np.interp(distance_m, at, offsets))

    def yaw_rad(self, distance_m: float) -> float:
        """Return the vehicle's yaw at a distance, 0 along the street, positive to the left."""
        ahead, behind = (self.offset_m(distance_m + d) for d in (_SLOPE_M, -_SLOPE_M))
        return math.radians(self.heading_deg) + math.atan2(ahead - behind, 2 * _SLOPE_M)

    def stamp_ns(self, index: int) -> int:
        """Return the time of a frame."""
        return self.start_ns + round(index * 1_000_000_000 / self.frame_rate_hz)


@dataclass(frozen=True, slots=True)
class Shot:
    """One frame of a drive, with its true pose."""

    stamp_ns: int
    image: Image  # (H, W, 3), BGR
    pose: Pose  # of the vehicle, in the world
    distance_m: float  # along the road
    odometry: Pose | None = None  # the measured pose, if it differs from the true pose
    camera: Camera | None = None

    @property
    def frame(self) -> Frame:
        """The shot as a frame, as from other sources."""
        gray = cv2.cvtColor(self.image, cv2.COLOR_BGR2GRAY)
        values = self.stamp_ns, gray, 'simulation', self.pose
        return Frame(*values, camera=self.camera)


def draw(road: Road, drive: Drive) -> Iterator[Shot]:
    """Yield the frames of a drive, drawn on demand; ConvseqError if it leaves the road."""
    ends_m = drive.start_m, drive.distance_m(drive.num_frames - 1)
    if max(ends_m) > road.length_m:
        raise ConvseqError(
            f'num_frames: the drive ends at {max(ends_m):g} m, '
            f'beyond the street of {road.length_m:g} m; draw a longer street'
        )
    if drive.num_frames and min(ends_m) < 0:
        raise ConvseqError(
            f'num_frames: the drive ends at {min(ends_m):g} m, before the street begins; '
            'let it begin further on'
        )
    light = LIGHTS[drive.light]
    grain = _grain(drive, light.noise + drive.noise)
    views: dict[Street, View] = {}
    for index in range(drive.num_frames):
        distance = drive.distance_m(index)
        spot = road.spot(distance, drive.offset_m(distance), drive.yaw_rad(distance))
        view = views.pop(spot.street, None) or View(
            spot.street, light, drive.width_px, drive.height_px, drive.field_of_view_deg
        )
        views[spot.street] = view
        if len(views) > _MOST_VIEWS:
            del views[next(iter(views))]
        yaw_rad = spot.street_yaw_rad + math.radians(drive.camera_yaw_deg)
        image = view.draw(spot.street_x, spot.street_y, yaw_rad)
        pose = _pose(spot.x, spot.y, spot.yaw_rad)
        exposed = _expose(image, drive, grain, index)
        values = drive.stamp_ns(index), exposed, pose, distance
        yield Shot(*values, camera=drive.camera)


def _pose(x: float, y: float, yaw_rad: float) -> Pose:
    return Pose((x, y, 0.0), (0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)))


def _grain(drive: Drive, strength: float) -> Image:
    """Return noise around 128, larger than an image; every frame uses a part of it."""
    rng = np.random.default_rng(drive.seed)
    shape = drive.height_px + 64, drive.width_px + 64, 3
    field = rng.standard_normal(shape, np.float32) * strength
    return np.clip(np.round(field + 128), 0, 255).astype(np.uint8)


def _expose(image: Image, drive: Drive, grain: Image, index: int) -> Image:
    row, column = np.random.default_rng((drive.seed, index)).integers(0, 64, 2)
    part = grain[row : row + drive.height_px, column : column + drive.width_px]
    exposed: Image = cv2.addWeighted(image, drive.brightness, part, 1.0, -128.0)
    return exposed
