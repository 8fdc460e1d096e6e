# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A camera driven along the street, with the truth of every frame."""

from collections.abc import Iterator
from dataclasses import dataclass
import math

from convseq_ros.core.types import Frame, Pose
from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.light import Image, LIGHTS
from convseq_ros.simulation.street import Street
from convseq_ros.simulation.view import View
import cv2
import numpy as np


@dataclass(frozen=True, slots=True)
class Drive:
    """
    How the street is driven.

    Parameters
    ----------
    start_m : float
        Where the first frame is taken, metres along the street.
    speed_mps : float
        Metres per second; 0 stands still.
    frame_rate_hz : float
    num_frames : int
    lane_offset_m : float
        To the left of the middle of the street; the right lane is at -1.5.
    heading_deg : float
        Yaw of the camera against the street, positive to the left.
    light : str
        'day', 'overcast', 'evening' or 'night'.
    brightness : float
        Exposure of the camera; 1 is normal.
    noise : float
        Standard deviation in grey levels that is added to the noise of the light.
    seed : int
        Decides the noise.
    start_ns : int
        Stamp of the first frame, nanoseconds.
    width_px, height_px : int
    field_of_view_deg : float
        Horizontal.

    """

    start_m: float = 0.0
    speed_mps: float = 10.0
    frame_rate_hz: float = 10.0
    num_frames: int = 150
    lane_offset_m: float = -1.5
    heading_deg: float = 0.0
    light: str = 'day'
    brightness: float = 1.0
    noise: float = 0.0
    seed: int = 0
    start_ns: int = 1_700_000_000_000_000_000
    width_px: int = 640
    height_px: int = 480
    field_of_view_deg: float = 80.0

    def __post_init__(self) -> None:
        if self.light not in LIGHTS:
            raise ConvseqError(f'light: {self.light!r} is not one of {", ".join(LIGHTS)}')
        for name in ('frame_rate_hz', 'width_px', 'height_px'):
            if not getattr(self, name) > 0:
                raise ConvseqError(f'{name}: {getattr(self, name)} is not positive')
        for name in ('start_m', 'speed_mps', 'num_frames', 'brightness', 'noise', 'seed'):
            if not getattr(self, name) >= 0:
                raise ConvseqError(f'{name}: {getattr(self, name)} is negative')
        if not abs(self.lane_offset_m) <= 3.0:
            raise ConvseqError(
                f'lane_offset_m: {self.lane_offset_m} is off the lanes; stay within -3 .. 3'
            )
        if not 20 <= self.field_of_view_deg <= 140:
            raise ConvseqError(
                f'field_of_view_deg: {self.field_of_view_deg} is outside 20 .. 140'
            )

    def distance_m(self, index: int) -> float:
        """Return how far along the street a frame is taken."""
        return self.start_m + self.speed_mps * index / self.frame_rate_hz

    def stamp_ns(self, index: int) -> int:
        """Return when a frame is taken."""
        return self.start_ns + round(index * 1_000_000_000 / self.frame_rate_hz)


@dataclass(frozen=True, slots=True)
class Shot:
    """
    One frame of a drive and its truth.

    Parameters
    ----------
    stamp_ns : int
    image : ndarray of uint8, shape (H, W, 3)
        BGR.
    pose : Pose
        Of the vehicle: x forward, y left, z up; the camera looks along its x.
    distance_m : float
        Along the street.

    """

    stamp_ns: int
    image: Image
    pose: Pose
    distance_m: float

    @property
    def frame(self) -> Frame:
        """The same as every other source yields it."""
        gray = cv2.cvtColor(self.image, cv2.COLOR_BGR2GRAY)
        return Frame(self.stamp_ns, gray, 'simulation', self.pose)


def draw(street: Street, drive: Drive) -> Iterator[Shot]:
    """
    Yield the frames of a drive, drawn as they are asked for.

    Raises
    ------
    ConvseqError
        If the drive goes beyond the end of the street.

    """
    if drive.distance_m(drive.num_frames - 1) > street.length_m:
        raise ConvseqError(
            f'num_frames: the drive ends at {drive.distance_m(drive.num_frames - 1):g} m, '
            f'beyond the street of {street.length_m:g} m; draw a longer street'
        )
    light = LIGHTS[drive.light]
    view = View(street, light, drive.width_px, drive.height_px, drive.field_of_view_deg)
    grain = _grain(drive, light.noise + drive.noise)
    heading = math.radians(drive.heading_deg)
    orientation = (0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))
    for index in range(drive.num_frames):
        distance = drive.distance_m(index)
        image = view.draw(distance, drive.lane_offset_m, heading)
        pose = Pose((distance, drive.lane_offset_m, 0.0), orientation)
        yield Shot(drive.stamp_ns(index), _expose(image, drive, grain, index), pose, distance)


def _grain(drive: Drive, strength: float) -> Image:
    """Return noise about 128, larger than an image, from which every frame takes a part."""
    rng = np.random.default_rng(drive.seed)
    shape = drive.height_px + 64, drive.width_px + 64, 3
    field = rng.standard_normal(shape, np.float32) * strength
    return np.clip(np.round(field + 128), 0, 255).astype(np.uint8)


def _expose(image: Image, drive: Drive, grain: Image, index: int) -> Image:
    row, column = np.random.default_rng((drive.seed, index)).integers(0, 64, 2)
    part = grain[row:row + drive.height_px, column:column + drive.width_px]
    exposed: Image = cv2.addWeighted(image, drive.brightness, part, 1.0, -128.0)
    return exposed
