# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how often one of two aisles that look alike is taken for the other.

Usage: python scripts/aisles.py [--metres 250] [--streets 1 2] [--alike 0] [--threads 1], two
minutes a street and a share. Aisles A and B are drawn streets with houses of the same shapes, the
given share of them painted alike, and the same lamps, but other trees, parked cars, signs and
roads. They are mapped by day, and driven through again .4 m to the side, by day (odd streets) or
in the evening, without odometry: B where only A is mapped; both again as they were mapped; and
both the other way round, where nothing of the map is seen, but if B is `turned`, A back looks as
B did, and B back as A did. Right is in the same aisle within 5 m. With a share of 0, twins lead
over other places by as much as alike aisles of a real office do; with .5, as a true place does
between day and night.
"""

import argparse
from collections import Counter
from dataclasses import dataclass, replace
from itertools import chain
import math
import sys

from convseq_ros import build_map, Config, Frame, PlaceRecognizer
from convseq_ros.config import make_config
from convseq_ros.simulation.drive import draw, Drive, Way
from convseq_ros.simulation.street import Spot, Street

RIGHT_M = 5.0
MARGIN_M = 10.0  # of an aisle, before and after what is driven
LANE_M, ASIDE_M = -1.0, 0.4
NOISE = {'day': 1.0, 'evening': 2.0}
BACK = 'both the other way round', 'both the other way round, B turned'
SHOWN = ('B, A mapped', 'both again', *BACK)
PASSED_OVER = ('between_keyframes', 'stationary')
Place = tuple[str, float]  # an aisle, and how far along it
Shots = list[tuple[Place, Frame]]


@dataclass(frozen=True, slots=True)
class Turned:
    """A street that is driven from its other end."""

    street: Street

    @property
    def length_m(self) -> float:
        """How far it may be driven."""
        return self.street.length_m

    def spot(self, distance_m: float, offset_m: float, yaw_rad: float) -> Spot:
        """Return where one is after a distance, so far to the left, turned so far from ahead."""
        return self.street.spot(self.length_m - distance_m, -offset_m, yaw_rad + math.pi)


def driven(way: Way, name: str, again: str = '', back: bool = False) -> Shots:
    """Return frames 1 m apart through an aisle, `again` in some light, and where each is taken."""
    light, lane_m = again or 'day', LANE_M + (ASIDE_M if again else 0.0)
    metres = round(way.length_m - 2 * MARGIN_M)
    drive = Drive(
        start_m=metres + MARGIN_M if back else MARGIN_M,
        speed_mps=-10.0 if back else 10.0,
        heading_deg=180.0 if back else 0.0,
        num_frames=metres,
        lane_offset_m=-lane_m if back else lane_m,
        light=light,
        noise=NOISE[light],
        seed=10 * ord(name) + 2 * bool(again) + back,
        width_px=320,
        height_px=240,
    )
    return [((name, shot.distance_m), replace(shot.frame, pose=None)) for shot in draw(way, drive)]


def one_drive(*parts: Shots) -> Shots:
    """Return parts of a drive one after the other, a tenth of a second from frame to frame."""
    shots = chain.from_iterable(parts)
    return [
        (place, replace(frame, stamp_ns=(index + 1) * 100_000_000))
        for index, (place, frame) in enumerate(shots)
    ]


def count(mapped: Shots, asked: Shots, back: bool, config: Config) -> Counter[str]:
    """Recognise one drive in a map of another."""
    reference_map = build_map([frame for _, frame in mapped], None, config)
    where = {frame.stamp_ns: place for place, frame in mapped}
    recognizer, counts = PlaceRecognizer(reference_map, config), Counter[str](frames=len(asked))
    for (aisle, here_m), frame in asked:
        match = recognizer.process(frame)
        counts['keyframes'] += match.reason not in PASSED_OVER
        if accepted := match.accepted:
            found, there_m = where[accepted.reference_stamp_ns]
            right = found == aisle and abs(there_m - here_m) <= RIGHT_M and not back
            counts['right' if right else 'false'] += 1
    return counts


def main() -> int:
    """Draw, map, recognise, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--metres', type=int, default=250)
    parser.add_argument('--streets', type=int, nargs='+', default=[1, 2])
    parser.add_argument('--alike', type=float, nargs='+', default=[0.0])
    parser.add_argument('--threads', type=int, default=0)
    chosen = parser.parse_args()
    config = make_config({'threads': chosen.threads})
    found = {(share, name): Counter[str]() for share in chosen.alike for name in SHOWN}
    for street in chosen.streets:
        light = 'day' if street % 2 else 'evening'
        way = Street(chosen.metres + 2 * MARGIN_M, street)
        mapped, again, back = (
            driven(way, 'A'),
            driven(way, 'A', light),
            driven(way, 'A', light, True),
        )
        for share in chosen.alike:
            twin = replace(way, things_seed=1000 + street, alike=share)
            twin_mapped, twin_again = driven(twin, 'B'), driven(twin, 'B', light)
            turned = Turned(twin)
            turned_mapped, turned_back = driven(turned, 'B'), driven(turned, 'B', light, True)
            twin_back = driven(twin, 'B', light, True)
            for name, maps, asked in (
                (SHOWN[0], (mapped,), (twin_again,)),
                (SHOWN[1], (mapped, twin_mapped), (again, twin_again)),
                (BACK[0], (mapped, twin_mapped), (back, twin_back)),
                (BACK[1], (mapped, turned_mapped), (back, turned_back)),
            ):
                counts = count(one_drive(*maps), one_drive(*asked), name in BACK, config)
                print(street, light, share, name, dict(counts), file=sys.stderr, flush=True)
                found[share, name].update(counts)
    print('| alike | driven | frames | keyframes | right | false |')
    print('|---|---|---|---|---|---|')
    for (share, name), counts in found.items():
        told = (str(counts[key]) for key in ('frames', 'keyframes', 'right', 'false'))
        print(f'| {share:g} | {name} | {" | ".join(told)} |')
    return 0


if __name__ == '__main__':
    sys.exit(main())
