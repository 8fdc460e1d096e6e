# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what drives are recognised of their own past: three rounds of a town, and ways without loops.

Usage: python scripts/rounds.py [--towns 1 2] [--data FOLDER] [--threads 1], two minutes a town.
Drawn towns are driven round three times in one drive, up to .6 m to the side of one line, in
online mode without odometry; right is within 5 m of where the camera is. With a folder of data
sets, their drives, forwards and backwards, are told nothing but their own past, every frame of it
but the latest 20: they pass every place once, so all that is accepted is false.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
import math
from pathlib import Path
import sys

from convseq_ros import build_map, Config, Frame, PlaceRecognizer
from convseq_ros.config import make_config
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.route import Corner, Route
from convseq_ros.sources.folder import FRAME_INTERVAL_NS, ImageFolder
import numpy as np

RIGHT_M = 5.0
BLOCK: tuple[Corner, ...] = ((0.0, 0.0), (120.0, 0.0), (120.0, 80.0), (0.0, 80.0))
START: Corner = (10.0, 0.0)  # on the first street; also the end
ROUNDS = 3
LANE_M, ASIDE_M, LANES_EVERY_M = -1.0, 0.6, 30.0
NOISE = 2.0
RECENT = 20  # frames that are no own past yet
PASSED_OVER = ('between_keyframes', 'stationary')
OWN_PASTS = (
    'corridor/query', 'corridor/ref', 'gardens_point/day_left', 'gardens_point/day_right',
    'road_1/images', 'road_2/images',
)  # fmt: skip


def town(seed: int) -> Route:
    """Return a way some times round a block."""
    first, *corners = BLOCK
    return Route((START, *corners, *BLOCK * (ROUNDS - 1), first, START), seed)


def rounds(seed: int) -> tuple[float, list[tuple[float, Frame]]]:
    """Return how long a round is, and how far frames 1 m apart are, with the poses they have."""
    route, rng = town(seed), np.random.default_rng(seed)
    at = np.arange(0.0, route.length_m + LANES_EVERY_M, LANES_EVERY_M)
    lanes = LANE_M + rng.uniform(-ASIDE_M, ASIDE_M, len(at))
    drive = Drive(
        num_frames=int(route.length_m),
        lanes=tuple(zip(at.tolist(), lanes.tolist(), strict=True)),
        noise=NOISE,
        seed=seed,
        width_px=320,
        height_px=240,
    )
    print(f'town {seed}: drawing {drive.num_frames} frames', file=sys.stderr, flush=True)
    return route.length_m / ROUNDS, [(one.distance_m, one.frame) for one in draw(route, drive)]


def count(seed: int, config: Config) -> list[Counter[str]]:
    """Recognise a drive's own past, round by round."""
    round_m, shots = rounds(seed)
    recognizer = PlaceRecognizer(build_map([], None, config), config)
    found = [Counter[str]() for _ in range(ROUNDS)]
    where = {frame.stamp_ns: frame.pose.position for _, frame in shots if frame.pose}
    for at_m, frame in shots:
        counts = found[min(int(at_m / round_m), ROUNDS - 1)]
        match = recognizer.process(replace(frame, pose=None))
        counts['keyframes'] += match.reason not in PASSED_OVER
        if accepted := match.accepted:
            off_m = math.dist(where[accepted.reference_stamp_ns], where[frame.stamp_ns])
            counts['right' if off_m <= RIGHT_M else 'false'] += 1
    return found


def own_past(frames: Sequence[Frame], config: Config) -> int:
    """Return how many frames are accepted as others of their drive."""
    recognizer = PlaceRecognizer(build_map([], None, config), config)
    stamps_ns = [frame.stamp_ns for frame in frames]
    again = (replace(one, stamp_ns=at) for one, at in zip(frames, sorted(stamps_ns), strict=True))
    return sum(recognizer.process(frame).accepted is not None for frame in again)


def main() -> int:
    """Draw, recognise, and print two tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--towns', type=int, nargs='*', default=[1, 2])
    parser.add_argument('--data', type=Path)
    parser.add_argument('--threads', type=int, default=0)
    chosen = parser.parse_args()
    online = {'threads': chosen.threads, 'mode': 'online'}
    if chosen.data:
        step_s = FRAME_INTERVAL_NS / 1e9
        recent = {'keyframe_overlap': 1.0, 'exclusion_s': (RECENT - 0.5) * step_s}
        config = make_config({**online, **recent})
        print('| drive | frames | accepted forwards | backwards |')
        print('|---|---|---|---|')
        for name in OWN_PASTS:
            frames = list(ImageFolder(chosen.data / name))
            ways = [own_past(way, config) for way in (frames, frames[::-1])]
            print(f'| {name} | {len(frames)} | {ways[0]} | {ways[1]} |', flush=True)
        print()
    print('| town | round | keyframes | right | recall | false |')
    print('|---|---|---|---|---|---|')
    for town_seed in chosen.towns:
        for number, counts in enumerate(count(town_seed, make_config(online)), 1):
            keyframes, right = counts['keyframes'], counts['right']
            share = f'{right / keyframes:.3f}' if number > 1 else ''
            told = f'{keyframes} | {right} | {share} | {counts["false"]}'
            print(f'| {town_seed} | {number} | {told} |', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
