# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what sessions of other light add to a map, and what knowing looks of a place is worth.

Usage: python scripts/looks.py [--metres 300] [--towns 1], five minutes a town. Drawn towns are
driven by day, in the evening, under clouds and at night, up to 1 m to the side of one line;
later drives by day, evening and night are recognised in maps of some of these sessions, without
odometry. Right is within 5 m of where the camera is. `without looks` counts other looks of a place
as its rivals. `--night-noise 8` adds noise of so many grey levels to later drives by night.
"""

from collections import Counter
from contextlib import redirect_stdout
from pathlib import Path
import sys
import tempfile

from convseq_ros import build_map, Config, Frame, PlaceRecognizer
from convseq_ros.cli import main as convseq
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.types import Candidate
from drives import (
    away_m,
    blind,
    count,
    head,
    HOUR_NS,
    lanes,
    options,
    RIGHT_M,
    row,
    shots,
    START_NS,
    town,
)
import numpy as np

MAPPED = ('day', 'evening', 'overcast', 'night')
NOISE = {'day': 1.0, 'overcast': 1.0, 'evening': 2.0, 'night': 4.0}
MAPS = (('day',), ('day', 'evening'), MAPPED)
QUERIES = ('day', 'evening', 'night')
RULES = {'': [], ' without looks': ['--no-links']}


def driven(seed: int, number: int, light: str, metres: int, more_noise: float) -> list[Frame]:
    """Return the frames of a drive by its number, each with the pose that it really has."""
    route = town(seed)
    line = lanes(route.length_m, -1.0, 1.0, np.random.default_rng([seed, number]))
    drawn = shots(
        route, start_m=0.13 * number, num_frames=min(metres, int(route.length_m - 1)), lanes=line,
        light=light, noise=NOISE[light] + more_noise, seed=100 * seed + number,
        start_ns=START_NS + number * HOUR_NS,
    )  # fmt: skip
    return [frame for _, frame in drawn]


def recognised(path: str, own: tuple[str, ...], asked: list[Frame]) -> Counter[str]:
    """Recognise a drive; count the sessions that answered, too."""
    whole, counts = open_map(path), Counter[str]()
    true = {frame.stamp_ns: frame.pose for frame in asked}

    def is_right(frame: Frame, found: Candidate) -> bool:
        place = whole.places[found.reference_index]
        counts[f'session {own[place.session]}'] += 1
        return away_m(place.pose, true[frame.stamp_ns]) <= RIGHT_M

    return count(PlaceRecognizer(whole, Config()), blind(asked), is_right) + counts


def main() -> None:
    """Draw, map, recognise, and print a table."""
    chosen = options(__doc__, metres=300, towns=1, night_noise=0.0)
    found = {
        (own, query, rule): Counter[str]()
        for own in MAPS
        for query in QUERIES
        for rule in RULES
        if not rule or len(own) > 1
    }
    for seed in range(1, chosen.towns + 1):
        noise = {light: chosen.night_noise * (light == 'night') for light in QUERIES}
        asked = {
            light: driven(seed, number, light, chosen.metres, noise[light])
            for number, light in enumerate(QUERIES, len(MAPPED))
        }
        with tempfile.TemporaryDirectory() as folder, redirect_stdout(sys.stderr):
            for number, light in enumerate(MAPPED):
                build_map(driven(seed, number, light, chosen.metres, 0.0), f'{folder}/{light}.db')
            for (own, query, rule), counts in found.items():
                path = f'{folder}/{" ".join(own)}{rule}.db'
                if not Path(path).exists():
                    names = [f'{folder}/{light}.db' for light in own]
                    convseq(['map', 'merge', *names, '-o', path, *RULES[rule]])
                counts.update(recognised(path, own, asked[query]))
    head('map', 'query', 'right of keyframes', 'false', 'sessions that answered')
    for (own, query, rule), counts in found.items():
        told = ', '.join(
            f'{light} {counts[f"session {light}"]}' for light in own if counts[f'session {light}']
        )
        right = f'{counts["right"]} of {counts["keyframes"]}'
        row(', '.join(own) + rule, query, right, counts['false'], told)


if __name__ == '__main__':
    main()
