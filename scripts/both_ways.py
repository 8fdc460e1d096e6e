# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what is recognised of drawn streets that are driven both ways.

Usage: python scripts/both_ways.py [--streets 1 2] [--metres 200], some three minutes a street.
The map is of the front camera of a drive by day. Later drives go in reverse gear, with that
camera, and back, turned round, with a front and a rear one, then also in a map without poses; 1 m
and 3 m (the opposite lane) to the side, by day and in the evening, without odometry. A place is
recalled if a camera recognises it within 5 m of where the robot is; further off, or with the
camera that looks the other way, a match is false. `turned` is the median error of the base's
heading against the place's, in degrees.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
import math
import sys

from convseq_ros import build_map, Config, Frame
from convseq_ros.config import MatchingConfig
from convseq_ros.core.cameras import Cameras
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
import numpy as np

RIGHT_M = 5.0
LANE_M = -1.5
NOISE = {'day': 1.0, 'evening': 2.0}
FRONT, REAR = '/front', '/rear'
YAW_DEG = {FRONT: 0.0, REAR: 180.0}
# How the street is driven again: heading, and which cameras see it.
WAYS = {'in reverse gear': (0.0, (FRONT,)), 'back, two cameras': (180.0, (FRONT, REAR))}
BOTH = Config(matching=MatchingConfig(both_directions=True))
RULES = {'one': Config(), 'both': BOTH, 'both, no poses': BOTH}


@dataclass(slots=True)
class Counts:
    """What came of some drives."""

    places: int = 0
    recalled: int = 0
    false: int = 0
    turned_deg: list[float] = field(default_factory=list)


def driven(street: int, metres: int, source: str, **how: object) -> list[tuple[float, Frame]]:
    """Return frames 1 m apart, and how far along the street each is taken."""
    drive = Drive(num_frames=metres, width_px=320, height_px=240, **how)
    drive = replace(drive, camera_yaw_deg=YAW_DEG[source])
    shots = draw(Street(metres + 20.0, street), drive)
    return [(shot.distance_m, replace(shot.frame, source=source)) for shot in shots]


def count(
    reference_map: ReferenceMap, at: dict[int, float], config: Config, drives: Iterator, to: Counts
) -> None:
    """Recognise what the cameras saw, frame by frame together."""
    shown = list(drives)
    cameras = Cameras(reference_map, config, [shots[0][1].source for shots in shown])
    heading = np.median([_yaw_rad(shots[0][1].pose.orientation) for shots in shown])
    for together in zip(*shown, strict=True):
        to.places += 1
        recalled = False
        for here_m, frame in together:
            match = cameras.process(replace(frame, pose=None))
            if accepted := match.accepted:
                right = abs(at[accepted.reference_stamp_ns] - here_m) <= RIGHT_M
                # The front camera on the way back sees no place of the map.
                right &= len(shown) == 1 or frame.source == REAR
                recalled, to.false = recalled or right, to.false + (not right)
                if match.relative_yaw_rad is not None:
                    off_rad = math.remainder(match.relative_yaw_rad - heading, math.tau)
                    to.turned_deg.append(abs(math.degrees(off_rad)))
        to.recalled += recalled


def _yaw_rad(orientation: tuple[float, ...]) -> float:
    return 2 * math.atan2(orientation[2], orientation[3])


def main() -> int:
    """Draw, map, recognise, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--metres', type=int, default=200)
    parser.add_argument('--streets', type=int, nargs='+', default=[1, 2])
    chosen = parser.parse_args()
    found: dict[tuple[str, float, str, str], Counts] = {}
    for street in chosen.streets:
        how = {'seed': 10 * street, 'lane_offset_m': LANE_M, 'noise': NOISE['day']}
        first = driven(street, chosen.metres, FRONT, start_m=10.0, **how)
        frames = [frame for _, frame in first]
        with_poses = build_map(frames)
        without = build_map([replace(frame, pose=None) for frame in frames])
        at = {frame.stamp_ns: here_m for here_m, frame in first}
        for way, (heading_deg, sources) in WAYS.items():
            for aside_m in (1.0, 3.0):
                for number, (light, noise) in enumerate(NOISE.items(), 1):
                    how = {
                        'start_m': chosen.metres + 9.7,
                        'speed_mps': -10.0,
                        'heading_deg': heading_deg,
                        'lane_offset_m': LANE_M + aside_m,
                        'light': light,
                        'noise': noise,
                    }
                    seeds = {one: 10 * street + number + 2 * (one == REAR) for one in sources}
                    shown = [
                        driven(street, chosen.metres, one, seed=seed, **how)
                        for one, seed in seeds.items()
                    ]
                    for rule, config in RULES.items():
                        if rule == ('one' if heading_deg else 'both, no poses'):
                            continue  # nearly the same images as in reverse gear
                        reference_map = without if 'no poses' in rule else with_poses
                        key = way, aside_m, light, rule
                        counts = found.setdefault(key, Counts())
                        count(reference_map, at, config, iter(shown), counts)
                        print(street, *key, counts.recalled, counts.false, file=sys.stderr)
    print('| driven | to the side | light | directions | recalled of places | false | turned |')
    print('|---|---|---|---|---|---|---|')
    for (way, aside_m, light, rule), counts in found.items():
        told = f'{counts.recalled} of {counts.places} | {counts.false}'
        turned = f'{np.median(counts.turned_deg):.1f}°' if counts.turned_deg else ''
        print(f'| {way} | {aside_m:g} m | {light} | {rule} | {told} | {turned} |')
    return 0


if __name__ == '__main__':
    sys.exit(main())
