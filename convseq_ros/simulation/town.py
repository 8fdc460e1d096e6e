# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drive through a drawn town that passes its streets again, with drifting odometry."""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path

from convseq_ros.simulation.drive import draw, Drive, Shot
from convseq_ros.simulation.odometry import Drift, with_odometry
from convseq_ros.simulation.recording import write_recording
from convseq_ros.simulation.route import Route
import numpy as np

DRIFT = Drift(scale=0.015, yaw_bias_deg=3.0, noise_m=0.02, yaw_noise_deg=3.0, seed=1)
BLOCK_M = 110.0, 70.0  # width and depth of a block
_SPEED_MPS, _RATE_HZ = 6.0, 4.0
_LANE_M, _WANDER_M, _WANDER_EVERY_M = -1.5, 0.4, 30.0


def two_blocks(width_m: float, depth_m: float, seed: int = 0) -> Route:
    """
    Return a route once round a block, and then round this block and the next one together.

    `seed` is that of the houses.
    """
    west, middle, east = 0.0, width_m, 2 * width_m
    block = ((10.0, 0.0), (middle, 0.0), (middle, depth_m), (west, depth_m), (west, 0.0))
    both = ((east, 0.0), (east, depth_m), (west, depth_m), (west, 0.0), (width_m / 2, 0.0))
    return Route((*block, *both), seed=7 + seed)


def shots(route: Route, drift: Drift = DRIFT, seed: int = 0) -> Iterator[Shot]:
    """Yield the frames of the drive: by day in the first half, under clouds in the second."""
    rng = np.random.default_rng(seed)
    at = np.arange(0.0, route.length_m + _WANDER_EVERY_M, _WANDER_EVERY_M)
    offsets = _LANE_M + rng.uniform(-_WANDER_M, _WANDER_M, len(at))
    half = int(route.length_m / 2 / _SPEED_MPS * _RATE_HZ)
    rest = int(route.length_m / _SPEED_MPS * _RATE_HZ) - half
    first = Drive(
        speed_mps=_SPEED_MPS,
        frame_rate_hz=_RATE_HZ,
        num_frames=half,
        width_px=320,
        height_px=240,
        lanes=tuple(zip(at.tolist(), offsets.tolist(), strict=True)),
        seed=seed,
    )
    second = replace(
        first,
        num_frames=rest,
        seed=seed + 1,
        light='overcast',
        start_m=first.distance_m(half),
        start_ns=first.stamp_ns(half),
    )
    return with_odometry(chain(draw(route, first), draw(route, second)), drift)


def record(path: Path, seed: int = 0) -> None:
    """Write the drive as a recording: images, the camera, /odom, and the truth."""
    drift = replace(DRIFT, seed=DRIFT.seed + seed)
    drawn = shots(two_blocks(*BLOCK_M, seed), drift, 2 * seed)
    write_recording(path, drawn, info_topic='/camera/camera_info')


if __name__ == '__main__':
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument('recording', type=Path, help='folder to make')
    record(parser.parse_args().recording)
