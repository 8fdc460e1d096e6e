# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the recall on drawn streets that are driven in both directions.

Usage: python scripts/both_ways.py [--streets 1 2] [--metres 200], about three minutes per street.
The map is made with the front camera by day. Later drives go in reverse gear with that camera, or
back, turned round, with a front and a rear camera; the latter also with a map without poses. They
are 1 m and 3 m (the opposite lane) to the side, by day and in the evening, without odometry. A
place is recalled if a camera recognises it within 5 m of the robot. A match further away, or by
the camera that looks the other way, is false. `turned` is the median error of the base's heading
relative to the place, in degrees.
"""

from collections import Counter, defaultdict
from dataclasses import replace
import math

from convseq_ros import build_map, Config
from convseq_ros.app.cameras import Cameras
from convseq_ros.config import MatchingConfig
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.simulation.street import Street
from drives import blind, head, options, RIGHT_M, row, Shots, shots
import numpy as np

LANE_M = -1.5
NOISE = {'day': 1.0, 'evening': 2.0}
FRONT, REAR = '/front', '/rear'
YAW_DEG = {FRONT: 0.0, REAR: 180.0}
# The second drive: heading and cameras.
DRIVES = {'in reverse gear': (0.0, (FRONT,)), 'back, two cameras': (180.0, (FRONT, REAR))}
BOTH = Config(matching=MatchingConfig(both_directions=True))
RULES = {'one': Config(), 'both': BOTH, 'both, no poses': BOTH}


def driven(street: int, metres: int, source: str, **how: object) -> Shots:
    """Return the frames of one camera."""
    yaw = {'camera_yaw_deg': YAW_DEG[source]}
    drawn = shots(Street(metres + 20.0, street), num_frames=metres, **yaw, **how)
    return [(at_m, replace(frame, source=source)) for at_m, frame in drawn]


def mapped_by_day(street: int, metres: int) -> Shots:
    """Return the frames of the front camera on the way that is mapped."""
    how = {'seed': 10 * street, 'lane_offset_m': LANE_M, 'noise': NOISE['day']}
    return driven(street, metres, FRONT, start_m=10.0, **how)


def driven_back(
    street: int, metres: int, source: str, heading_deg: float, aside_m: float, light: str
) -> Shots:
    """Return the frames of a camera on the way back, to the side of the first way."""
    number = [*NOISE].index(light) + 1
    how = {
        'seed': 10 * street + number + 2 * (source == REAR),
        'start_m': metres + 9.7,
        'speed_mps': -10.0,
        'heading_deg': heading_deg,
        'lane_offset_m': LANE_M + aside_m,
        'light': light,
        'noise': NOISE[light],
    }
    return driven(street, metres, source, **how)


def recognised(
    reference_map: ReferenceMap, at: dict[int, float], config: Config, shown: list[Shots]
) -> tuple[Counter[str], list[float]]:
    """Return the counts of simultaneous camera frames, and the heading errors in degrees."""
    counts, turned_deg = Counter[str](), list[float]()
    cameras = Cameras(reference_map, config, [shots[0][1].source for shots in shown])
    turns = [shots[0][1].pose.orientation for shots in shown]
    heading = np.median([2 * math.atan2(turn[2], turn[3]) for turn in turns])
    for frames in zip(*shown, strict=True):
        recalled = False
        for here_m, frame in frames:
            match = cameras.process(replace(frame, pose=None))
            if accepted := match.accepted:
                right = abs(at[accepted.reference_stamp_ns] - here_m) <= RIGHT_M
                # The front camera on the way back sees no place of the map.
                right &= len(shown) == 1 or frame.source == REAR
                recalled, counts['false'] = recalled or right, counts['false'] + (not right)
                if match.relative_yaw_rad is not None:
                    error_rad = math.remainder(match.relative_yaw_rad - heading, math.tau)
                    turned_deg.append(abs(math.degrees(error_rad)))
        counts['places'] += 1
        counts['recalled'] += recalled
    return counts, turned_deg


def main() -> None:
    """Draw, map, recognise, and print a table."""
    chosen = options(__doc__, metres=200, streets=[1, 2])
    results: dict[tuple[str, str, str, str], Counter[str]] = defaultdict(Counter)
    turned_deg: dict[tuple[str, str, str, str], list[float]] = defaultdict(list)
    for street in chosen.streets:
        first = mapped_by_day(street, chosen.metres)
        frames, at = [frame for _, frame in first], {one.stamp_ns: at for at, one in first}
        with_poses, without = build_map(frames), build_map(blind(frames))
        for drive, (heading_deg, sources) in DRIVES.items():
            for aside_m in (1.0, 3.0):
                for light in NOISE:
                    shown = [
                        driven_back(street, chosen.metres, one, heading_deg, aside_m, light)
                        for one in sources
                    ]
                    for rule, config in RULES.items():
                        if rule == ('one' if heading_deg else 'both, no poses'):
                            continue  # nearly the same images as in reverse gear
                        reference_map = without if 'no poses' in rule else with_poses
                        key = drive, f'{aside_m:g} m', light, rule
                        counts, turned = recognised(reference_map, at, config, shown)
                        results[key].update(counts)
                        turned_deg[key] += turned
    head('driven', 'to the side', 'light', 'directions', 'recalled of places', 'false', 'turned')
    for key, counts in results.items():
        off = f'{np.median(turned_deg[key]):.1f}°' if turned_deg[key] else ''
        row(*key, f'{counts["recalled"]} of {counts["places"]}', counts['false'], off)


if __name__ == '__main__':
    main()
