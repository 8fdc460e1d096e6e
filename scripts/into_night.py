# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what a drive finds that goes on from day into night.

Usage: python scripts/into_night.py [--streets 3 4], two minutes a street. A drawn street is driven
once by day and then twice by night, in one process: in a map of an earlier day, and in its own
map, which a lap by day makes before. A match is right within 5 m.
"""

from collections import Counter
from dataclasses import replace
from typing import Any

from convseq_ros import build_map, PlaceRecognizer
from convseq_ros.config import Config
from convseq_ros.simulation.street import Street
from drives import head, HOUR_NS, options, RIGHT_M, row, Shots, shots, START_NS
from known_drives import config_of

STREET_M, LANE_M = 200, -1.5
LAPS = {'by day': 'day', 'first by night': 'night', 'second by night': 'night'}


def driven(street: int, number: int, **how: Any) -> Shots:
    """Return the frames of a lap; the first one is that of the map."""
    return shots(
        Street(STREET_M + 20.0, street), num_frames=STREET_M, seed=10 * street + number,
        start_ns=START_NS + number * HOUR_NS, **how,
    )  # fmt: skip


def lap_counts(mapped: Shots, laps: list[Shots], config: Config) -> list[Counter[str]]:
    """Return the counts of each lap, and after how many keyframes its first right match is."""
    frames, found = [frame for _, frame in mapped], []
    true = {frame.stamp_ns: at_m for lap in (mapped, *laps) for at_m, frame in lap}
    is_own = config.online.grows
    recognizer = PlaceRecognizer(build_map([] if is_own else frames, None, config), config)
    for frame in frames if is_own else ():
        recognizer.process(frame)
    for lap in laps:
        counts = Counter[str]()
        for at_m, frame in lap:
            if match := recognizer.process(replace(frame, pose=None)).accepted:
                is_right = abs(true[match.reference_stamp_ns] - at_m) <= RIGHT_M
                counts['right' if is_right else 'false'] += 1
                if is_right and 'first' not in counts:
                    counts['first'] = counts['keyframes']
            counts['keyframes'] += 1
        found.append(counts)
    return found


def main() -> None:
    """Draw, recognise, and print a row a lap."""
    chosen = options(__doc__, streets=[3, 4])
    head('street', 'map', 'lap', 'keyframes', 'right', 'false', 'first right after')
    for street in chosen.streets:
        mapped = driven(street, 0, start_m=10.0, lane_offset_m=LANE_M, noise=1.0)
        later = {'start_m': 10.4, 'lane_offset_m': LANE_M + 0.5, 'noise': 2.0}
        laps = [
            driven(street, number, light=light, **later)
            for number, light in enumerate(LAPS.values(), start=1)
        ]
        for whose, mode in (('of an earlier day', 'preloaded'), ('its own', 'online')):
            for lap, one in zip(LAPS, lap_counts(mapped, laps, config_of(mode=mode)), strict=True):
                first = one['first'] if 'first' in one else '-'
                row(street, whose, lap, one['keyframes'], one['right'], one['false'], first)


if __name__ == '__main__':
    main()
