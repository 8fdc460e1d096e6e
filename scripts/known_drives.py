# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drives of which each frame's place is known: the sets of the benchmark.

A position is a number of a frame or of a place along the way. It is nan if it is unknown, and
infinite if no map has it.

laps is a circuit that is driven again and again, with the truth of places on its first lap. A row
of the truth counts from 8 matches of SIFT on, for frames at most 8 away.
"""

from collections.abc import Callable
import csv
from dataclasses import dataclass, replace
from functools import partial
import math
from pathlib import Path
from typing import Any

from convseq_ros import Config, Frame
from convseq_ros.config import make_config
from convseq_ros.evaluation.protocols import kept_halves
from convseq_ros.sources.folder import ImageFolder
import numpy as np

STEP_NS = 10**8  # between images of pieces
PIECE = 30  # images between jumps
LAP, LAP_RIGHT, LAP_WRONG = 840, 40, 100  # places of laps
MIN_MATCHES, REACH = 8, 8  # of a row of its truth, and the row's reach in frames
FIRST_LAP = 1231  # its last frame, by its name
# The car is carried ahead by 90 places, and stands; the truth tells places 832 to 39. SIFT and a
# fundamental matrix find 93 inliers of frame 1236 in place 92, and at most 65 where the truth is.
CARRIED = range(1232, 1372)
Shown = list[tuple[Frame, float]]  # with positions


@dataclass(frozen=True)
class Drive:
    """A map, and a drive; without a map, the drive maps its own way."""

    name: str
    mapped: Shown
    queries: Shown
    config: Config
    right: float = 5.0  # from the truth: an answer is right
    wrong: float = 15.0  # ... and wrong beyond
    lap: float = math.inf  # length after which positions repeat
    place: str = ''  # the place on earth, which has one vote

    def off(self, here: float, there: np.ndarray) -> np.ndarray:
        """Return the distances (n,) of positions from one; nan where one is unknown."""
        if math.isinf(here):
            return np.where(np.isnan(there), math.nan, math.inf)
        away = abs(there - here)
        return np.minimum(away, abs(self.lap - away)) if math.isfinite(self.lap) else away


Make = Callable[[], Drive]


def config_of(**changes: Any) -> Config:
    """Return the default configuration with changes, on one thread."""
    return make_config({'threads': 1, **changes})


def of_corridor(folder: Path, half: str) -> Drive:
    """Return the drive through the corridor in half of its map."""
    return _in_half(f'corridor {half}', folder / 'ref', folder / 'query', half)


def own_corridor(folder: Path) -> Drive:
    """Return the drive through the corridor, which maps its way."""
    return Drive(
        'own corridor', [], _counted(folder / 'ref'), config_of(mode='online'), place='corridor'
    )


def of_gardens(folder: Path, half: str) -> Drive:
    """Return the walk on the left side in half of a map of the right side."""
    drive = _in_half(f'gardens {half}', folder / 'day_right', folder / 'day_left', half)
    return replace(drive, right=2, wrong=10)


def of_office(folder: Path) -> Drive:
    """Return the second round through an office, which maps its way."""
    with (folder / 'loops_gt.csv').open(newline='') as rows:
        truth = {int(row['frame']): float(row['revisits']) for row in csv.DictReader(rows)}
    pictures = enumerate(ImageFolder(folder), start=1)
    queries = [(frame, truth.get(number, float(number))) for number, frame in pictures]
    return Drive('rtabmap84', [], queries, config_of(mode='online'), place='rtabmap84')


def number(frame: Frame) -> int:
    """Return the number of a frame, which is the name of its picture."""
    return int(Path(frame.source).stem)


def circuit(folder: Path) -> Shown:
    """Return the frames of laps, with their places on the first lap."""
    with (folder / 'ground_truth.csv').open(newline='') as rows:
        sure = [row for row in csv.DictReader(rows) if int(row['matches']) >= MIN_MATCHES]
    truth = {int(row['frame']): int(row['place']) for row in sure}

    def place(here: int) -> float:
        near = min(truth, key=lambda frame: abs(frame - here))
        is_known = here not in CARRIED and abs(here - near) <= REACH
        return float((truth[near] + here - near) % LAP) if is_known else math.nan

    return [(frame, place(number(frame))) for frame in ImageFolder(folder / 'drive')]


def other_circuit(folder: Path) -> Shown:
    """Return the frames of the other circuit of laps, which no map has."""
    return [(frame, math.inf) for frame in ImageFolder(folder / 'other')]


def until(shown: Shown, last: int) -> int:
    """Return how many frames are not after that of a number."""
    return sum(number(frame) <= last for frame, _ in shown)


def pieces_of(shown: Shown) -> list[Shown]:
    """Return pieces of a drive in a drawn order, a tenth of a second between images."""
    pieces = [shown[at : at + PIECE] for at in range(0, len(shown), PIECE)]
    np.random.default_rng(0).shuffle(pieces)
    stamps = iter(range(10**15, 10**15 + len(shown) * STEP_NS, STEP_NS))
    return [[(replace(one, stamp_ns=next(stamps)), at) for one, at in piece] for piece in pieces]


def lap_drive(name: str, mapped: Shown, queries: Shown, config: Config | None = None) -> Drive:
    """Return a drive on the circuit of laps."""
    by = LAP_RIGHT, LAP_WRONG, LAP, 'laps'
    return Drive(name, mapped, queries, config or config_of(), *by)


def of_laps(folder: Path, what: str) -> Drive:
    """
    Return the drive after the first lap, the other circuit, laps online, or pieces of laps.

    Or, for `half first` and so on, the drive after the first lap in half of the map.
    """
    shown = circuit(folder)
    first = until(shown, FIRST_LAP)
    mapped, queries, config = shown[:first], shown[first:], config_of()
    if what == 'online':
        mapped, queries, config = [], shown, config_of(mode='online')
    elif what.startswith('half'):
        begin, end = kept_halves(len(mapped))[what.split()[1]]
        mapped = mapped[begin:end]
    elif what == 'other':
        queries = other_circuit(folder)
    elif what == 'jumps':
        queries = [one for piece in pieces_of(queries) for one in piece]
    return lap_drive(f'laps {what}', mapped, queries, config)


def _in_half(name: str, mapped: Path, driven: Path, half: str) -> Drive:
    """Return a drive in half of a map, each keyframe of which is a frame."""
    places, queries = _counted(mapped), _counted(driven)
    first, last = kept_halves(len(places))[half]
    config, place = config_of(keyframe_overlap=1.0), name.split()[0]
    return Drive(name, places[first:last], queries, config, place=place)


def _counted(folder: Path) -> Shown:
    return [(frame, float(index)) for index, frame in enumerate(ImageFolder(folder))]


def benchmark(data: Path) -> list[Make]:
    """Return the drives through the corridor, laps, the garden path and the office."""
    corridor, gardens = data / 'corridor', data / 'gardens_point'
    halves = 'first', 'middle', 'last'
    of_lap = 'first', 'online', 'jumps', 'half first', 'half middle', 'half last', 'other'
    return [
        *(partial(of_laps, data / 'laps', what) for what in of_lap),
        *(partial(of_corridor, corridor, half) for half in halves),
        partial(own_corridor, corridor),
        *(partial(of_gardens, gardens, half) for half in halves),
        partial(of_office, data / 'rtabmap84'),
    ]
