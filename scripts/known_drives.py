# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drives of which each frame's place is known, to fit constants on.

A position is a distance along the way: in metres if drawn, otherwise in frames. It is nan if it is
unknown, and infinite if no map has it.
"""

from collections.abc import Callable, Sequence
import csv
from dataclasses import dataclass, replace
from functools import partial
import math
from pathlib import Path
from typing import Any

import aisles
import both_ways
from convseq_ros import Config, Frame
from convseq_ros.config import make_config
from convseq_ros.evaluation.protocols import kept_halves
from convseq_ros.simulation.street import Street
from convseq_ros.sources.folder import ImageFolder
from drawn_drives import drawn, Pair, PAIRS
from drives import HOUR_NS, START_NS
import laps
import numpy as np

RIGHT, WRONG = 5.0, 15.0
TWIN = 1e6  # position where a twin aisle begins
STREET_M = 200  # driven in reverse gear, or into the night
PIECE, STEP_NS = 30, 10**8  # images between jumps, and between images
Shown = list[tuple[Frame, float]]  # with positions


@dataclass(frozen=True)
class Drive:
    """A map, and a drive; without a map, the drive maps its own way."""

    name: str
    mapped: Shown
    queries: Shown
    config: Config
    right: float = RIGHT  # from the truth: an answer is right
    wrong: float = WRONG  # ... and wrong beyond
    lap: float = math.inf  # length after which positions repeat
    place: str = ''  # the place on earth, which has one vote; drawn drives have none

    def off(self, here: float, there: np.ndarray) -> np.ndarray:
        """Return the distances (n,) of positions from one; nan where one is unknown."""
        if math.isinf(here):
            return np.where(np.isnan(there), math.nan, math.inf)
        away = abs(there - here)
        return np.minimum(away, abs(self.lap - away)) if math.isfinite(self.lap) else away


Make = Callable[[], Drive]


def config_of(changes: dict[str, Any], **more: Any) -> Config:
    """Return the default configuration with changes, on one thread."""
    return make_config({'threads': 1, **changes, **more})


def of_street(pair: Pair, changes: dict[str, Any]) -> Drive:
    """Return a drawn drive in the middle half of its map."""
    (queries, there), (mapped, here) = drawn(pair, True), drawn(pair, False)
    first, last = kept_halves(len(mapped))['middle']
    kept = list(zip(mapped, here.tolist(), strict=True))[first:last]
    shown = list(zip(queries, there.tolist(), strict=True))
    return Drive(pair.name, kept, shown, config_of(changes))


def own_street(pair: Pair, changes: dict[str, Any]) -> Drive:
    """Return a drawn drive that never returns and maps its way."""
    shown = zip(*drawn(pair, True), strict=True)
    queries = [(frame, float(at)) for frame, at in shown]
    return Drive(f'own {pair.name}', [], queries, config_of(changes, mode='online'))


def of_corridor(folder: Path, changes: dict[str, Any], half: str = 'middle') -> Drive:
    """Return the drive through the corridor in half of its map."""
    config = config_of(changes, keyframe_overlap=1.0)
    mapped, queries = (_counted(folder / name) for name in ('ref', 'query'))
    first, last = kept_halves(len(mapped))[half]
    return Drive(f'corridor {half}', mapped[first:last], queries, config, place='corridor')


def own_corridor(folder: Path, changes: dict[str, Any]) -> Drive:
    """Return the drive through the corridor, which maps its way."""
    config = config_of(changes, mode='online')
    return Drive('own corridor', [], _counted(folder / 'ref'), config, place='corridor')


def of_gardens(folder: Path, changes: dict[str, Any], half: str) -> Drive:
    """Return the walk on the left side in half of a map of the right side."""
    mapped, queries = (_counted(folder / name) for name in ('day_right', 'day_left'))
    first, last = kept_halves(len(mapped))[half]
    config = config_of(changes, keyframe_overlap=1.0)
    kept = mapped[first:last]
    return Drive(f'gardens {half}', kept, queries, config, 2, 10, place='gardens')


def of_office(folder: Path, changes: dict[str, Any]) -> Drive:
    """Return the second round through an office, which maps its way."""
    with (folder / 'loops_gt.csv').open(newline='') as rows:
        truth = {int(row['frame']): float(row['revisits']) for row in csv.DictReader(rows)}
    pictures = enumerate(ImageFolder(folder), start=1)
    queries = [(frame, truth.get(number, float(number))) for number, frame in pictures]
    config = config_of(changes, mode='online')
    return Drive('rtabmap84', [], queries, config, place='rtabmap84')


def of_laps(folder: Path, changes: dict[str, Any], what: str) -> Drive:
    """
    Return the drive after the first lap, the other circuit, laps online, or pieces of laps.

    Or, for `half first` and so on, the drive after the first lap in half of the map.
    """
    truth = laps.read_truth(folder / 'ground_truth.csv')
    shown = []
    for frame in ImageFolder(folder / 'drive'):
        at = laps.place(truth, laps.number(frame))
        shown.append((frame, math.nan if at is None else float(at)))
    first = sum(laps.number(frame) <= laps.FIRST_LAP for frame, _ in shown)
    mapped, queries = shown[:first], shown[first:]
    if what == 'online':
        mapped, queries = [], shown
    elif what.startswith('half'):
        begin, end = kept_halves(len(mapped))[what.split()[1]]
        mapped = mapped[begin:end]
    elif what == 'other':
        queries = [(frame, math.inf) for frame in ImageFolder(folder / 'other')]
    elif what == 'jumps':
        pieces = [queries[at : at + PIECE] for at in range(0, len(queries), PIECE)]
        np.random.default_rng(0).shuffle(pieces)
        begun_ns = 10**15
        queries = [
            (replace(frame, stamp_ns=begun_ns + number * STEP_NS), at)
            for number, (frame, at) in enumerate(one for piece in pieces for one in piece)
        ]
    config = config_of(changes, mode='online' if what == 'online' else 'preloaded')
    return Drive(f'laps {what}', mapped, queries, config, laps.RIGHT, laps.WRONG, laps.LAP, 'laps')


def of_aisles(seed: int, light: str, changes: dict[str, Any], what: str) -> Drive:
    """Return a drive through aisle B, or A and B, of which A, both, or both turned are mapped."""
    aisle = Street(250 + 2 * aisles.MARGIN_M, seed)
    twin = replace(aisle, things_seed=1000 + seed, alike=0.0)
    turned = aisles.Turned(twin)
    back = what in ('back', 'turned')
    other = turned if what == 'turned' else twin
    maps = [aisles.driven(aisle, 'A')] + [aisles.driven(other, 'B')] * (what != 'only A')
    parts = [aisles.driven(other, 'B', light, back)]
    if what != 'only A':
        parts.insert(0, aisles.driven(aisle, 'A', light, back))

    def placed(shown: Sequence[aisles.Shown], is_mapped: bool) -> Shown:
        return [
            (frame, at_m + TWIN * (aisle == 'B') if is_mapped else math.inf)
            for (aisle, at_m), frame in aisles.one_drive(tuple(shown))
        ]

    name = f'aisles {what} {seed}'
    return Drive(name, placed(maps, True), placed(parts, what == 'both'), config_of(changes))


def in_reverse(street: int, changes: dict[str, Any]) -> Drive:
    """Return a drive in reverse gear, 3 m to the side and in the evening, of a street by day."""
    mapped = both_ways.mapped_by_day(street, STREET_M)
    back = both_ways.driven_back(street, STREET_M, both_ways.FRONT, 0.0, 3.0, 'evening')
    queries = [(replace(frame, pose=None), at_m) for at_m, frame in back]
    shown = [(frame, at_m) for at_m, frame in mapped]
    return Drive(f'in reverse {street}', shown, queries, config_of(changes))


def into_night(street: int, changes: dict[str, Any]) -> Drive:
    """Return a drive by day, and an hour later twice by night, of a street by day."""
    mapped = [(frame, at_m) for at_m, frame in both_ways.mapped_by_day(street, STREET_M)]
    queries = []
    for number, light in enumerate(('day', 'night', 'night'), start=1):
        how = {'light': light, 'noise': 2.0, 'seed': 10 * street + number, 'start_m': 10.4}
        how |= {'lane_offset_m': both_ways.LANE_M + 0.5, 'start_ns': START_NS + number * HOUR_NS}
        shown = both_ways.driven(street, STREET_M, both_ways.FRONT, **how)
        queries += [(replace(frame, pose=None), at_m) for at_m, frame in shown]
    return Drive(f'into night {street}', mapped, queries, config_of(changes))


def _counted(folder: Path) -> Shown:
    return [(frame, float(index)) for index, frame in enumerate(ImageFolder(folder))]


def streets(changes: dict[str, Any]) -> list[Make]:
    """Return the drawn drives of `PAIRS`, in the middle halves of their maps."""
    return [partial(of_street, pair, changes) for pair in PAIRS]


def drawn_ones(changes: dict[str, Any]) -> list[Make]:
    """Return drawn drives: of streets, their own way, twins, in reverse gear, into the night."""
    found = streets(changes)
    found += [partial(own_street, PAIRS[at], changes) for at in (2, 9, 11)]
    for seed, light in ((1, 'day'), (2, 'evening')):
        found += [partial(of_aisles, seed, light, changes, what) for what in ('only A', 'turned')]
    found.append(partial(of_aisles, 1, 'day', changes, 'both'))
    found += [partial(in_reverse, street, changes) for street in (1, 2)]
    return [*found, partial(into_night, 3, changes)]


def real(data: Path, changes: dict[str, Any]) -> list[Make]:
    """Return the drives through the corridor, laps, the garden path and the office."""
    corridor, gardens = data / 'corridor', data / 'gardens_point'
    halves = 'first', 'middle', 'last'
    of_lap = 'first', 'online', 'jumps', 'half first', 'half middle', 'half last', 'other'
    return [
        *(partial(of_laps, data / 'laps', changes, what) for what in of_lap),
        *(partial(of_corridor, corridor, changes, half) for half in halves),
        partial(own_corridor, corridor, changes),
        *(partial(of_gardens, gardens, changes, half) for half in halves),
        partial(of_office, data / 'rtabmap84', changes),
    ]
