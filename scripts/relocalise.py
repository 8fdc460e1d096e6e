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

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path

from convseq_ros import build_map, Config, Frame, PlaceRecognizer
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.types import Descriptor, Localization, LocalizationState, Pose
from convseq_ros.simulation.odometry import Drift, DriftingOdometer
from convseq_ros.sources import open_source
from drives import away_m, head, HOUR_NS, lanes, options, RIGHT_M, row, shots, START_NS, town
import numpy as np

PATIENCE, FEW = 15, 5  # frames until a start has failed, in the town and in Gardens Point
BEFORE, AFTER = 15, 20  # frames before and after a kidnapping
APART_M = 30.0  # smallest distance of a kidnapping
ASIDE_M = 2.0
DRIFT = Drift(scale=0.015, yaw_bias_deg=3.0, noise_m=0.02, yaw_noise_deg=3.0)
HEADS = 'robot', 'starts', 'right', 'wrong', 'frames', 'metres', 'off m', 'quality'
Described = Iterable[tuple[Frame, Descriptor]]
Shown = list[tuple[Frame, Descriptor]]


@dataclass(frozen=True)
class Outcome:
    """The result of one start."""

    frames: int | None = None  # until it was localised; None if never
    metres: float = 0.0  # distance driven until then
    off_m: float = 0.0  # from the recognised place to the camera
    quality: float = 0.0


def driven(seed: int, light: str, aside_m: float, noise: float, frames: int) -> Shown:
    """Return frames 1 m apart, with their true poses."""
    route, later = town(seed), aside_m > 0
    line = lanes(route.length_m, -1.0, aside_m, np.random.default_rng(seed))
    drawn = shots(
        route, start_m=0.4 * later, num_frames=min(frames, int(route.length_m - 1)), lanes=line,
        light=light, noise=noise, seed=seed, start_ns=START_NS + HOUR_NS * later,
    )  # fmt: skip
    return [(frame, describe(frame.gray)) for _, frame in drawn if frame.gray is not None]


def with_odometry(shown: Described, odometer: DriftingOdometer) -> Described:
    """Yield frames with poses of drifting odometry instead of true poses."""
    for frame, descriptor in shown:
        yield replace(frame, pose=frame.pose and odometer.moved_to(frame.pose)), descriptor


def is_localised(now: Localization | None) -> bool:
    """Return whether the robot is localised."""
    return bool(now and now.state is LocalizationState.LOCALISED)


def localised(recognizer: PlaceRecognizer, frames: Described, true: Sequence[Pose]) -> Outcome:
    """Feed frames until the robot is localised."""
    metres, before = 0.0, true[0]
    for number, ((frame, descriptor), here) in enumerate(zip(frames, true, strict=False), 1):
        metres, before = metres + away_m(here, before), here
        now = recognizer.process(frame, descriptor).localization
        if is_localised(now) and now.reference_index is not None:
            place = recognizer.reference_map.places[now.reference_index].pose
            return Outcome(number, metres, away_m(place, here), now.quality or 0.0)
    return Outcome(None, metres)


def poses(shown: Shown) -> list[Pose]:
    """Return the poses of frames."""
    return [frame.pose for frame, _ in shown if frame.pose]


def starts(recognizer: PlaceRecognizer, shown: Shown, count: int) -> list[Outcome]:
    """Return the outcomes of `count` starts."""
    outcomes = []
    begins = np.random.default_rng(0).integers(0, len(shown) - PATIENCE, count).tolist()
    for number, begin in enumerate(begins):
        recognizer.reset()
        part = shown[begin : begin + PATIENCE]
        odometer = DriftingOdometer(replace(DRIFT, seed=number))
        outcomes.append(localised(recognizer, with_odometry(part, odometer), poses(part)))
    return outcomes


def kidnappings(
    recognizer: PlaceRecognizer, shown: Shown, count: int
) -> list[tuple[int | None, Outcome]]:
    """Return per kidnapping the frames until it was noticed, and the outcome of the new start."""
    rng, results = np.random.default_rng(1), list[tuple[int | None, Outcome]]()
    while len(results) < count:
        first, second = rng.integers(0, len(shown) - max(BEFORE, AFTER), 2).tolist()
        there = poses(shown[second : second + AFTER])
        if away_m(shown[first + BEFORE - 1][0].pose, there[0]) < APART_M:
            continue
        odometer = DriftingOdometer(replace(DRIFT, seed=len(results)))
        start_ns = shown[first][0].stamp_ns
        recognizer.reset()
        both = [*shown[first : first + BEFORE], *shown[second : second + AFTER]]
        stamped = [
            (replace(one, stamp_ns=start_ns + index * 10**8), descriptor)
            for index, (one, descriptor) in enumerate(both)
        ]
        here = localised(recognizer, with_odometry(stamped[:BEFORE], odometer), poses(both))
        for frame, descriptor in with_odometry(stamped[here.frames or BEFORE : BEFORE], odometer):
            recognizer.process(frame, descriptor)
        if not is_localised(recognizer.localizer.localization):
            continue
        odometer.lift()
        noticed = None
        for number, (frame, descriptor) in enumerate(with_odometry(stamped[BEFORE:], odometer), 1):
            now = recognizer.process(frame, descriptor).localization
            if now and not is_localised(now):
                noticed = number
                break
        rest = stamped[BEFORE + (noticed or AFTER) :]
        then = localised(recognizer, with_odometry(rest, odometer), there[noticed or 0 :] or there)
        frames = None if then.frames is None else then.frames + (noticed or 0)
        results.append((noticed, replace(then, frames=frames)))
    return results


def gardens_point(folder: Path) -> list[Outcome]:
    """Return the outcomes of starts at every frame of Gardens Point; `off_m` is in frames."""
    left, right = (
        [
            (Frame((index + 1) * 10**9, frame.gray), describe(frame.gray))
            for index, frame in enumerate(open_source(folder / name))
            if frame.gray is not None
        ]
        for name in ('day_left', 'day_right')
    )
    recognizer, outcomes = PlaceRecognizer(build_map(frame for frame, _ in right)), []
    numbers = [place.stamp_ns // 10**9 - 1 for place in recognizer.reference_map.places]
    for begin in range(len(left) - FEW + 1):
        recognizer.reset()
        outcome = Outcome()
        for number, (frame, descriptor) in enumerate(left[begin : begin + FEW], begin):
            now = recognizer.process(frame, descriptor).localization
            if is_localised(now):
                off = abs(numbers[now.reference_index or 0] - number)
                outcome = Outcome(number - begin + 1, 0.0, off, now.quality or 0.0)
                break
        outcomes.append(outcome)
    return outcomes


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
    recognizer = PlaceRecognizer(build_map(mapped, config=Config()))
    recognizer.matcher.warm_up()
    print(f'{len(recognizer.reference_map)} places; {PATIENCE} frames a start')
    head(*HEADS)
    for light, noise in (('evening', 0.0), ('night', 8.0)):
        shown, count = driven(7, light, ASIDE_M, noise, chosen.frames), chosen.starts // 4
        print_row(f'{light}, up to 2 m aside', starts(recognizer, shown, chosen.starts))
        taken = kidnappings(recognizer, shown, count)
        noticed = np.mean([frames is not None and frames <= FEW for frames, _ in taken])
        name = f'{light}, kidnapped, {100 * noticed:.0f} % noticed within 5 frames'
        print_row(name, [outcome for _, outcome in taken])
    elsewhere = driven(99, 'evening', ASIDE_M, 0.0, min(chosen.frames, 420))
    print_row('outside the map', starts(recognizer, elsewhere, chosen.starts // 2), -1.0)
    if chosen.data:
        print_row('Gardens Point', gardens_point(chosen.data / 'gardens_point'), 2)


if __name__ == '__main__':
    main()
