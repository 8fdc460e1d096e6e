# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what a drive finds that goes on from day into night.

Usage: python scripts/into_night.py [--streets 3 4] [--threads 1], two minutes a street. A drawn
street is driven once by day and then twice by night, in one process: in a map of an earlier day,
and in its own map, which a lap by day makes before. A match is right within 5 m.
"""

from collections import Counter

from convseq_ros import build_map, PlaceRecognizer
from convseq_ros.config import Config, make_config
from drives import head, options, row
from known_drives import Drive, into_night, RIGHT

LAPS = 'by day', 'first by night', 'second by night'


def laps(drive: Drive, config: Config) -> list[Counter[str]]:
    """Return the counts of each lap, and after how many keyframes its first right match is."""
    frames, found = [frame for frame, _ in drive.mapped], []
    true = {frame.stamp_ns: at_m for frame, at_m in (*drive.mapped, *drive.queries)}
    is_own = config.online.grows
    recognizer = PlaceRecognizer(build_map([] if is_own else frames, None, config), config)
    for frame in frames if is_own else ():
        recognizer.process(frame)
    length = len(drive.queries) // len(LAPS)
    for number in range(len(LAPS)):
        counts = Counter[str]()
        for frame, at_m in drive.queries[number * length :][:length]:
            if match := recognizer.process(frame).accepted:
                is_right = abs(true[match.reference_stamp_ns] - at_m) <= RIGHT
                counts['right' if is_right else 'false'] += 1
                if is_right and 'first' not in counts:
                    counts['first'] = counts['keyframes']
            counts['keyframes'] += 1
        found.append(counts)
    return found


def main() -> None:
    """Draw, recognise, and print a row a lap."""
    chosen = options(__doc__, streets=[3, 4], threads=0)
    head('street', 'map', 'lap', 'keyframes', 'right', 'false', 'first right after')
    for street in chosen.streets:
        drive = into_night(street, {'threads': chosen.threads})
        for whose, mode in (('of an earlier day', 'preloaded'), ('its own', 'online')):
            config = make_config({'threads': chosen.threads, 'mode': mode})
            for lap, one in zip(LAPS, laps(drive, config), strict=True):
                first = one['first'] if 'first' in one else '-'
                row(street, whose, lap, one['keyframes'], one['right'], one['false'], first)


if __name__ == '__main__':
    main()
