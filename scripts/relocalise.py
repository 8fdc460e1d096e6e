# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how soon a robot localises after a start anywhere in the map, and how often it is wrong.

Usage: python scripts/relocalise.py [--data FOLDER] [--starts 200], about 15 minutes. A drawn town
is mapped by day and driven again in other light, up to 2 m to the side of the map's line. Each
start resets the recogniser; the odometry drifts. A localisation is right within 5 m of the
camera's position. FOLDER may hold gardens_point (day_left, day_right), where equal frame numbers
are the same place.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, starmap
import math
from pathlib import Path

from convseq_ros import build_map, PlaceRecognizer
from convseq_ros.core.types import LocalizationState, Pose
from convseq_ros.simulation.odometry import DriftingOdometer
from convseq_ros.simulation.town import DRIFT
from convseq_ros.sources.folder import ImageFolder
from drives import (
    away_m,
    Described,
    described,
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

PATIENCE, FEW = 15, 5  # frames until a start has failed, in the town and in Gardens Point
ASIDE_M = 2.0


@dataclass(frozen=True)
class Outcome:
    """The result of one start."""

    frames: int | None = None  # until it was localised; None if never
    off_m: float = 0.0  # from the recognised place to the camera
    quality: float = 0.0
    metres: float = 0.0  # distance driven until then


def driven(seed: int, light: str, aside_m: float, noise: float, frames: int) -> Described:
    """Return frames 1 m apart, with their true poses."""
    route, later = town(seed), aside_m > 0
    line = lanes(route.length_m, -1.0, aside_m, np.random.default_rng(seed))
    drawn = shots(
        route, start_m=0.4 * later, num_frames=min(frames, int(route.length_m - 1)), lanes=line,
        light=light, noise=noise, seed=seed, start_ns=START_NS + HOUR_NS * later,
    )  # fmt: skip
    return described(frame for _, frame in drawn)


def localised(
    recognizer: PlaceRecognizer, shown: Described, off_m: Callable[[int, int], float]
) -> Outcome:
    """Reset, and feed frames until the robot is localised; `off_m` is of a place and a frame."""
    recognizer.reset()
    for number, (frame, descriptor) in enumerate(shown):
        now = recognizer.process(frame, descriptor).localization
        if now and now.state is LocalizationState.LOCALISED and now.reference_index is not None:
            return Outcome(number + 1, off_m(now.reference_index, number), now.quality or 0.0)
    return Outcome()


def starts(recognizer: PlaceRecognizer, shown: Described, count: int) -> list[Outcome]:
    """Return the outcomes of `count` starts."""
    outcomes, places = [], recognizer.reference_map.places
    begins = np.random.default_rng(0).integers(0, len(shown) - PATIENCE, count).tolist()
    for number, begin in enumerate(begins):
        part = shown[begin : begin + PATIENCE]
        true = [frame.pose for frame, _ in part]
        odometer = DriftingOdometer(replace(DRIFT, seed=number))
        drifting = [
            (replace(frame, pose=frame.pose and odometer.moved_to(frame.pose)), descriptor)
            for frame, descriptor in part
        ]

        def off_m(place: int, at: int, true: list[Pose | None] = true) -> float:
            return away_m(places[place].pose, true[at])

        found = localised(recognizer, drifting, off_m)
        metres = sum(starmap(away_m, pairwise(true[: found.frames])))
        outcomes.append(replace(found, metres=metres))
    return outcomes


def gardens_point(folder: Path) -> list[Outcome]:
    """Return the outcomes of starts at every frame of Gardens Point; `off_m` is in frames."""
    left, right = (
        described(replace(frame, stamp_ns=(index + 1) * 10**9) for index, frame in enumerate(one))
        for one in (ImageFolder(folder / 'day_left'), ImageFolder(folder / 'day_right'))
    )
    recognizer = PlaceRecognizer(build_map(frame for frame, _ in right))
    numbers = [place.stamp_ns // 10**9 - 1 for place in recognizer.reference_map.places]
    return [
        localised(
            recognizer,
            left[begin : begin + FEW],
            lambda place, at, begin=begin: abs(numbers[place] - begin - at),  # type: ignore[misc]
        )
        for begin in range(len(left) - FEW + 1)
    ]


def print_row(name: str, outcomes: Sequence[Outcome], within: float = RIGHT_M) -> None:
    """Print a row of starts."""
    done = [item for item in outcomes if item.frames is not None]
    right = [item for item in done if item.off_m <= within]
    names = ('frames', 'metres', 'off_m')
    middle = [np.median([getattr(item, name) for item in right] or [math.nan]) for name in names]
    quality = np.mean([item.quality for item in done] or [math.nan])
    figures = f'{middle[0]:.0f}', f'{middle[1]:.1f}', f'{middle[2]:.2f}', f'{quality:.2f}'
    row(name, len(outcomes), f'{len(right) / len(outcomes):.3f}', len(done) - len(right), *figures)


def main() -> None:
    """Measure and print."""
    chosen = options(__doc__, data=None, starts=200, frames=10_000)
    mapped = (one for one, _ in driven(7, 'day', 0.0, 0.0, chosen.frames))
    recognizer = PlaceRecognizer(build_map(mapped))
    recognizer.matcher.warm_up()
    print(f'{len(recognizer.reference_map)} places; {PATIENCE} frames a start')
    head('robot', 'starts', 'right', 'wrong', 'frames', 'metres', 'off m', 'quality')
    for light, noise in (('evening', 0.0), ('night', 8.0)):
        shown = driven(7, light, ASIDE_M, noise, chosen.frames)
        print_row(f'{light}, up to 2 m aside', starts(recognizer, shown, chosen.starts))
    elsewhere = driven(99, 'evening', ASIDE_M, 0.0, min(chosen.frames, 420))
    print_row('outside the map', starts(recognizer, elsewhere, chosen.starts // 2), -1.0)
    if chosen.data:
        print_row('Gardens Point', gardens_point(chosen.data / 'gardens_point'), 2)


if __name__ == '__main__':
    main()
