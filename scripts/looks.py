# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what sessions of other light add to a map, and what knowing looks of a place is worth.

Usage: python scripts/looks.py [--metres 300] [--towns 1], five minutes a town. Drawn towns are
driven by day, in the evening, under clouds and at night, up to 1 m to the side of one line;
later drives by day, evening and night are recognised in maps of some of these sessions, without
odometry. Right is within 5 m of where the camera is. `without looks` counts other looks of a place
as its rivals. `--night-noise 8` adds noise of so many grey levels to later drives by night.
`--leads` prints by what the rule tells looks from other places instead.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
import sys
from typing import Any

from convseq_ros import Config, Frame, PlaceRecognizer
from convseq_ros.core.decision import neighbourhood
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map_builder import MapBuilder
from convseq_ros.core.matcher import make_matcher
from convseq_ros.core.types import Match, Reason
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.route import Route
import numpy as np

RIGHT_M = 5.0
LANE_M, ASIDE_M = -1.0, 1.0
START_NS, HOUR_NS = 1_700_000_000_000_000_000, 3600 * 10**9
MAPPED = ('day', 'evening', 'overcast', 'night')
NOISE = {'day': 1.0, 'overcast': 1.0, 'evening': 2.0, 'night': 4.0}
MAPS = (('day',), ('day', 'evening'), ('day', 'evening', 'overcast', 'night'))
QUERIES = ('day', 'evening', 'night')


@dataclass(slots=True)
class Counts:
    """What came of the keyframes of some drives."""

    keyframes: int = 0
    right: int = 0
    wrong: int = 0


def town(seed: int) -> Route:
    """Return a way of some 1,080 m through a town of 300 m by 200 m."""
    corners = ((10, 0), (150, 0), (150, 100), (0, 100), (0, 200), (300, 200), (300, 0), (190, 0))
    return Route(tuple((float(x), float(y)) for x, y in corners), seed=seed)


def driven(
    seed: int, number: int, light: str, metres: int, more_noise: float = 0.0
) -> list[Frame]:
    """Return frames 1 m apart of a drive by its number, each with the pose that it really has."""
    route, rng = town(seed), np.random.default_rng([seed, number])
    at = np.arange(0.0, route.length_m + 30, 30.0)
    lanes = np.clip(LANE_M + rng.uniform(-ASIDE_M, ASIDE_M, len(at)), -3.0, 3.0)
    drive = Drive(
        start_m=0.13 * number,
        num_frames=min(metres, int(route.length_m - 1)),
        lanes=tuple(zip(at.tolist(), lanes.tolist(), strict=True)),
        light=light,
        noise=NOISE[light] + more_noise,
        seed=100 * seed + number,
        width_px=320,
        height_px=240,
        start_ns=START_NS + number * HOUR_NS,
    )
    print(f'town {seed}: drawing {light}', file=sys.stderr)
    return [shot.frame for shot in draw(route, drive)]


def built(drives: Sequence[list[Frame]]) -> ReferenceMap:
    """Return a map of one session for each drive."""
    whole = ReferenceMap()
    for frames in drives:
        with MapBuilder(config=Config()) as builder:
            for frame in frames:
                builder.process(frame)
        one = builder.reference_map
        whole.sessions += one.sessions
        for index, place in enumerate(one.places):
            whole.add(replace(place, session=len(whole.sessions) - 1), one.packed(index))
    return whole


def count(recognizer: PlaceRecognizer, frames: list[Frame], counts: Counts) -> Counter[int]:
    """Recognise a drive; return the sessions that answered."""
    reference_map, sessions = recognizer.reference_map, Counter[int]()
    for frame in frames:
        match: Match = recognizer.process(frame)
        if match.reason in (Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY):
            continue
        counts.keyframes += 1
        if accepted := match.accepted:
            place = reference_map.places[accepted.reference_index].pose
            off_m = math.dist(place.position, frame.pose.position) if place and frame.pose else 0.0
            counts.right += off_m <= RIGHT_M
            counts.wrong += off_m > RIGHT_M
            sessions[accepted.session] += 1
    return sessions


def print_leads(drives: Sequence[list[Frame]]) -> None:
    """Print by how much looks of a place are verified better than the best of places elsewhere."""
    reference_map, rng = built(drives), np.random.default_rng(0)
    matcher, numbers = make_matcher(reference_map, Config()), neighbourhood.LOOKS.controls
    matcher.warm_up()
    poses = [place.pose for place in reference_map.places]
    at = np.array([pose.position for pose in poses if pose])
    session = np.array([place.session for place in reference_map.places])
    print(
        '| look at | place of | leads of looks: least, 5 %, middle | of places elsewhere: 95 % |'
    )
    print('|---|---|---|---|')
    for one in range(len(drives)):
        for other in set(range(len(drives))) - {one}:
            right: list[float] = []
            wrong: list[float] = []
            own, theirs = np.flatnonzero(session == one), np.flatnonzero(session == other)
            for index in own[5:-5:12].tolist():
                way_m = np.linalg.norm(at[theirs] - at[index], axis=1)
                look, away = int(theirs[way_m.argmin()]), theirs[way_m > 3 * RIGHT_M]
                asked = rng.choice(away, numbers + 1, replace=False).tolist()
                found = matcher.compared(index, [look, *asked])
                usual = max(found[at].strength for at in asked[1:])
                for place, leads in ((look, right), (asked[0], wrong)):
                    leads.append((found[place].strength - usual) / math.sqrt(max(usual, 1.0)))
            least, few, middle = np.percentile(right, (0, 5, 50))
            told = f'{least:.1f}, {few:.1f}, {middle:.1f} | {np.percentile(wrong, 95):.1f}'
            print(f'| {MAPPED[other]} | {MAPPED[one]} | {told} |', flush=True)


def main() -> int:
    """Draw, map, recognise, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--metres', type=int, default=300)
    parser.add_argument('--towns', type=int, default=1)
    parser.add_argument('--night-noise', type=float, default=0.0, help='added, in grey levels')
    parser.add_argument('--leads', action='store_true', help='how looks are told from others')
    chosen = parser.parse_args()
    if chosen.leads:
        print_leads([driven(1, *one, chosen.metres) for one in enumerate(MAPPED)])
        return 0
    usual: Any = neighbourhood.LOOKS
    rules = {'': usual, ' without looks': replace(usual, asked=0)}
    found = {
        (own, query, rule): (Counts(), Counter[int]())
        for own in MAPS
        for query in QUERIES
        for rule in rules
        if not rule or len(own) > 1
    }
    for seed in range(1, chosen.towns + 1):
        lights = (*MAPPED, *QUERIES)
        noise = [chosen.night_noise * (light == 'night') for light in QUERIES]
        drives = [
            driven(seed, number, light, chosen.metres, more)
            for number, (light, more) in enumerate(
                zip(lights, (*[0.0] * len(MAPPED), *noise), strict=True)
            )
        ]
        for (own, query, rule), (counts, sessions) in found.items():
            setattr(neighbourhood, 'LOOKS', rules[rule])  # noqa: B010
            reference_map = built([drives[MAPPED.index(light)] for light in own])
            shown = drives[len(MAPPED) + QUERIES.index(query)]
            recognizer = PlaceRecognizer(reference_map, Config())
            blind = [replace(frame, pose=None) for frame in shown]
            sessions.update(count(recognizer, blind, counts))
    print('| map | query | right of keyframes | false | sessions that answered |')
    print('|---|---|---|---|---|')
    for (own, query, rule), (counts, sessions) in found.items():
        told = ', '.join(f'{own[one]} {times}' for one, times in sorted(sessions.items()))
        name = ', '.join(own) + rule
        right = f'{counts.right} of {counts.keyframes}'
        print(f'| {name} | {query} | {right} | {counts.wrong} | {told} |')
    return 0


if __name__ == '__main__':
    sys.exit(main())
