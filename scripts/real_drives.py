# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Real drives, most of them in other light, of which each frame's place is known.

A folder of them holds `SET/DRIVE/NUMBER.jpg`, in driving order (lay_out.py). Rows of
truth/SET.csv beside this file say of a frame where on a lap it is and on how many matches of SIFT
that rests; room.csv has a digit for each mapped frame: the points that both show, at most 9. Their
pictures are others': they are measured with, and not shown.
"""

from collections.abc import Callable
import csv
from dataclasses import dataclass
from functools import lru_cache, partial
import math
from pathlib import Path

from convseq_ros import Frame
from convseq_ros.evaluation.protocols import kept_halves
import cv2
from known_drives import config_of, Drive, Make, Shown, STEP_NS
import numpy as np

TRUTH = Path(__file__).resolve().parent / 'truth'
DAY_NS = 86_400 * 10**9
CONFIG = config_of()


@dataclass(frozen=True)
class Set:
    """A round that is driven again and again, and its truth: places along a lap."""

    name: str
    lap: float  # places
    right: float  # from the truth, in places: an answer is right
    wrong: float  # ... and wrong beyond
    matches: int  # of SIFT that a row of the truth rests on, at least
    gap: int  # frames between rows over which places are interpolated

    def places(self, drive: str) -> Callable[[int], float]:
        """Return the place of a frame of a drive, by its number; nan if it is unknown."""
        with (TRUTH / f'{self.name}.csv').open(newline='') as rows:
            known = {
                int(row['frame']): float(row['place'])
                for row in csv.DictReader(rows)
                if row['drive'] == drive and int(row['matches']) >= self.matches
            }
        frames = np.array(sorted(known))
        places = np.array([known[frame] for frame in frames.tolist()])

        def place(number: int) -> float:
            at = int(np.searchsorted(frames, number))
            if at < len(frames) and frames[at] == number:
                return float(places[at])
            if at in (0, len(frames)):
                nearest = min(at, len(frames) - 1)
                is_close = abs(frames[nearest] - number) <= self.gap / 3
                return float(places[nearest]) if is_close else math.nan
            length = frames[at] - frames[at - 1]
            step = (places[at] - places[at - 1] + self.lap / 2) % self.lap - self.lap / 2
            if length > self.gap or abs(step) > self.lap / 4:
                return math.nan
            return float((places[at - 1] + step * (number - frames[at - 1]) / length) % self.lap)

        return place


@dataclass(frozen=True)
class Part:
    """Some images of a drive, by their numbers."""

    drive: str
    first: int = 0
    last: int = 10**9
    most: int | None = None  # images, from the first
    is_mapped: bool = True  # whether a map may have its places


COURT = Set('court', 284, 25, 50, 6, 60)
LOT = Set('lot', 70, 8, 16, 12, 20)
OFFICE = Set('office', 462, 20, 60, 12, 24)
HOUSE = Set('house', 176, 8, 20, 8, 12)


class Walk(Drive):
    """
    A room that is filmed twice with a phone in a hand.

    Two frames show the same scene if they share at least 8 points of a reconstruction, and
    another one if they share at most 2. The place of a frame that shares 8 with none of the map is
    unknown: the reconstruction lacks many views of a scene that is mapped. Positions are frame
    numbers.
    """

    def off(self, here: float, there: np.ndarray) -> np.ndarray:
        """Return 0 for places that show the frame's scene, 3 for others, 1.5 between."""
        around = [slice(max(0, int(at) - 3), int(at) + 4) for at in there]
        points = np.array([shared_points()[int(here)][one].max() for one in around])
        if not (points >= 8).any():
            return np.full(len(there), math.nan)
        return np.select([points >= 8, points <= 2], [0.0, 3.0], 1.5)


@lru_cache(1)
def shared_points() -> dict[int, np.ndarray]:
    """Return the points that a frame of the second round shares with those of the first, (n,)."""
    with (TRUTH / 'room.csv').open(newline='') as rows:
        return {
            int(row['frame']): np.array([*map(int, row['points'])]) for row in csv.DictReader(rows)
        }


def shown(folder: Path, place: Callable[[int], float], part: Part, start_ns: int = 0) -> Shown:
    """Return images of a drive, a tenth of a second apart, with their places."""
    found: Shown = []
    for file in sorted(folder.iterdir()):
        number = int(file.stem)
        if part.first <= number <= part.last and len(found) != part.most:
            gray = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
            found.append((Frame(start_ns + (len(found) + 1) * STEP_NS, gray), place(number)))
    return found


def of_laps(
    folder: Path, name: str, of: Set, mapped: Part, driven: Part, half: str | None = None
) -> Drive:
    """Return a drive in a map of another day, or in half of it."""

    def of_part(part: Part, start_ns: int) -> Shown:
        place = of.places(part.drive) if part.is_mapped else lambda _number: math.inf
        return shown(folder / of.name / part.drive, place, part, start_ns)

    places = of_part(mapped, 0)
    if half is not None:
        first, last = kept_halves(len(places))[half]
        name, places = f'{name}, {half} half', places[first:last]
    queries = of_part(driven, DAY_NS)
    return Drive(name, places, queries, CONFIG, of.right, of.wrong, of.lap, of.name)


def of_park(folder: Path, name: str, kept: Part, driven: str) -> Drive:
    """Return a drive through a park of which a part is mapped in another season."""
    images = shown(folder / 'park' / kept.drive, float, kept)
    return Drive(
        name, images, shown(folder / 'park' / driven, float, Part(driven), DAY_NS), CONFIG, 2, 6,
        place='park',
    )  # fmt: skip


def of_room(folder: Path, name: str) -> Drive:
    """Return the second round through a room in a map of the first."""
    first, second = Part('walk', 1, 282), Part('walk', 291, 464)
    mapped = shown(folder / 'room/walk', float, first)
    queries = shown(folder / 'room/walk', float, second, DAY_NS)
    return Walk(name, mapped, queries, CONFIG, 1, 2, place='room')


def of_straight(folder: Path) -> Drive:
    """Return a drive that maps a straight of a running track, slowly: nothing returns."""
    images = shown(folder / 'straight/drive', lambda _number: math.inf, Part('drive'))
    return Drive('straight, online', [], images, config_of(mode='online'))


def in_other_light(folder: Path) -> dict[str, Make]:
    """Return the drives by name; their makers read the images."""
    court_lap, evening = Part('0513_1442', 3851, 4135), Part('0513_1732', 6367, 7567, 400)
    office_lap = Part('1202', 72, 551)
    laps = (
        ('court evening', COURT, court_lap, evening),
        ('court noon', COURT, court_lap, Part('0514_1240', 0, 1200, 400)),
        ('court afternoon', COURT, court_lap, Part('0514_1407', 20290, 21490, 400)),
        ('court ten laps, evening', COURT, Part('0513_1442'), evening),
        ('lot two circles', LOT, Part('a', 500, 640), Part('b')),
        ('office week', OFFICE, office_lap, Part('1209', 0, 4000, 400)),
        ('office three months', OFFICE, office_lap, Part('0306')),
        ('office other way', OFFICE, office_lap, Part('1202_other_way', is_mapped=False)),
        (
            'office other way, month', OFFICE, office_lap,
            Part('1230_other_way', 0, 4000, 500, is_mapped=False),
        ),
        ('house one lap', HOUSE, Part('a', 212, 394), Part('b', most=400)),
        ('house three laps', HOUSE, Part('a', 212, 754), Part('b', most=400)),
    )  # fmt: skip
    parks = (
        ('park first', Part('0', 51, 100), '1'), ('park middle', Part('0', 26, 75), '1'),
        ('park last', Part('0', 0, 50), '1'), ('park back middle', Part('1', 26, 75), '0'),
    )  # fmt: skip
    in_half = [
        partial(of_laps, folder, *of, half=half)
        for of in laps if of[0] in ('court noon', 'office week', 'house one lap')
        for half in ('first', 'middle', 'last')
    ]  # fmt: skip
    return {
        **{of[0]: partial(of_laps, folder, *of) for of in laps},
        **{f'{one.args[1]}, {one.keywords["half"]} half': one for one in in_half},
        **{of[0]: partial(of_park, folder, *of) for of in parks},
        'room, hand-held': partial(of_room, folder, 'room, hand-held'),
        'straight, online': partial(of_straight, folder),
    }
