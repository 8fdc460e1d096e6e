# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shared by the other scripts: options, drawn drives, counts of matches, tables."""

import argparse
from collections.abc import Iterable
from dataclasses import replace
import math
from pathlib import Path
import sys
from typing import Any

from convseq_ros import Frame
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.types import Descriptor, Pose, Reason
from convseq_ros.simulation.drive import draw, Drive, Road
from convseq_ros.simulation.route import Route
from convseq_ros.sources.camera_info import read_camera_file
from convseq_ros.sources.folder import ImageFolder
from convseq_ros.sources.pose_file import read_pose_file
import numpy as np

RIGHT_M = 5.0
PASSED_OVER = Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY
START_NS, HOUR_NS = 1_700_000_000_000_000_000, 3600 * 10**9
Shots = list[tuple[float, Frame]]  # distance along the road in metres, and frame
Described = list[tuple[Frame, Descriptor]]


def options(description: str | None, **defaults: Any) -> argparse.Namespace:
    """
    Parse the command line, by defaults.

    `Path` is a path that must be given, None one that may be, [] are paths, a list several values,
    a tuple the values to choose from.
    """
    parser = argparse.ArgumentParser(allow_abbrev=False, description=description)
    for name, default in defaults.items():
        flag = f'--{name.replace("_", "-")}'
        if default is False:
            parser.add_argument(flag, action='store_true')
        elif default is Path:
            parser.add_argument(flag, type=Path, required=True)
        elif isinstance(default, tuple):
            parser.add_argument(flag, nargs='*', default=default, choices=default)
        elif isinstance(default, list):
            kind = type(default[0]) if default else Path
            parser.add_argument(flag, type=kind, nargs='*', default=default)
        else:
            kind = Path if default is None else type(default)
            parser.add_argument(flag, type=kind, default=default)
    return parser.parse_args()


def town(seed: int) -> Route:
    """Return a route of about 1,080 m through a town of 300 m by 200 m."""
    corners = ((10, 0), (150, 0), (150, 100), (0, 100), (0, 200), (300, 200), (300, 0), (190, 0))
    return Route(tuple((float(x), float(y)) for x, y in corners), seed=seed)


def lanes(
    length_m: float, middle_m: float, aside_m: float, rng: np.random.Generator
) -> tuple[tuple[float, float], ...]:
    """Return a line that wanders to both sides of a lane, for `Drive.lanes`."""
    at = np.arange(0.0, length_m + 30.0, 30.0)
    offsets = np.clip(middle_m + rng.uniform(-aside_m, aside_m, len(at)), -3.0, 3.0)
    return tuple(zip(at.tolist(), offsets.tolist(), strict=True))


def shots(road: Road, **how: Any) -> Shots:
    """Return the frames of a drive, by default of 320 x 240 px and 1 m apart."""
    drive = Drive(**{'width_px': 320, 'height_px': 240} | how)
    progress(f'drawing {drive.num_frames} frames by {drive.light}')
    return [(shot.distance_m, shot.frame) for shot in draw(road, drive)]


def road(folder: Path) -> list[Frame]:
    """Return the frames of a folder of KITTI's odometry: images/, poses.txt and calib.txt."""
    frames = [*ImageFolder(folder / 'images')]
    assert frames[0].gray is not None
    pose_at = read_pose_file(folder / 'poses.txt', len(frames))
    camera = read_camera_file(folder / 'calib.txt', *frames[0].gray.shape)
    return [
        replace(frame, pose=pose_at(number, frame.stamp_ns), camera=camera)
        for number, frame in enumerate(frames)
    ]


def described(frames: Iterable[Frame]) -> Described:
    """Return frames with their descriptors."""
    return [(frame, describe(frame.gray)) for frame in frames if frame.gray is not None]


def away_m(one: Pose | None, other: Pose | None) -> float:
    """Return the distance of two poses; infinity if one is missing."""
    return math.dist(one.position, other.position) if one and other else math.inf


def head(*names: str) -> None:
    """Print the head of a table."""
    row(*names)
    print('|---' * len(names) + '|')


def row(*cells: object) -> None:
    """Print a row of a table."""
    print(f'| {" | ".join(map(str, cells))} |', flush=True)


def progress(text: str) -> None:
    """Print a progress message."""
    print(text, file=sys.stderr, flush=True)
