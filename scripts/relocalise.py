# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how soon a robot that is switched on somewhere knows where it is, and how often it is wrong.

Usage: python scripts/relocalise.py [--data FOLDER] [--starts 200], some fifteen minutes. A drawn
town is mapped by day and driven again in other light, up to 2 m to the side of the map's line;
each start is a recogniser that has seen nothing, with odometry that drifts. Right is within 5 m of
where the camera is. FOLDER may hold gardens_point (day_left, day_right), whose frames have the
same numbers.
"""

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path
import sys
import time

from convseq_ros import build_map, Config, Frame, PlaceRecognizer
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.types import Descriptor, LocalizationState, Pose
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.odometry import Drift, Odometer
from convseq_ros.simulation.route import Route
from convseq_ros.sources import open_source
import numpy as np

RIGHT_M, RIGHT_FRAMES = 5.0, 2
PATIENCE = 15  # frames after which a start is given up
BEFORE, AFTER = 15, 20  # frames before and after a kidnapping
APART_M = 30.0  # that a robot is carried at least
MAP_LANE_M, ASIDE_M = -1.0, 2.0
DRIFT = Drift(scale=0.015, yaw_bias_deg=3.0, noise_m=0.02, yaw_noise_deg=3.0)
START_NS, HOUR_NS = 1_700_000_000_000_000_000, 3600 * 10**9
Shown = tuple[Frame, Descriptor]


def town(seed: int) -> Route:
    """Return a way of some 1,080 m through a town of 300 m by 200 m."""
    corners = ((10, 0), (150, 0), (150, 100), (0, 100), (0, 200), (300, 200), (300, 0), (190, 0))
    return Route(tuple((float(x), float(y)) for x, y in corners), seed=seed)


def driven(seed: int, light: str, aside_m: float, noise: float, frames: int) -> list[Shown]:
    """Return frames 1 m apart, each with the pose that it really has."""
    route, rng = town(seed), np.random.default_rng(seed)
    at = np.arange(0.0, route.length_m + 30, 30.0)
    lanes = np.clip(MAP_LANE_M + rng.uniform(-aside_m, aside_m, len(at)), -3.0, 3.0)
    drive = Drive(
        start_m=0.4 * (aside_m > 0),
        num_frames=min(frames, int(route.length_m - 1)),
        lanes=tuple(zip(at.tolist(), lanes.tolist(), strict=True)),
        light=light,
        noise=noise,
        seed=seed,
        width_px=320,
        height_px=240,
        start_ns=START_NS + HOUR_NS * (aside_m > 0),
    )
    said(f'drawing {drive.num_frames} frames by {light}')
    shots = (shot.frame for shot in draw(route, drive))
    return [(frame, describe(frame.gray)) for frame in shots if frame.gray is not None]


def with_odometry(shown: Iterable[Shown], odometer: Odometer) -> Iterator[Shown]:
    """Yield frames with what drifting odometry says instead of where they are."""
    for frame, descriptor in shown:
        yield replace(frame, pose=frame.pose and odometer.moved_to(frame.pose)), descriptor


@dataclass(frozen=True)
class Outcome:
    """What became of one start."""

    frames: int | None = None  # until it was localised; None if it never was
    metres: float = 0.0  # driven until then
    off_m: float = 0.0  # from where the recognised place is to where the camera is
    quality: float = 0.0

    @property
    def is_right(self) -> bool:
        return self.frames is not None and self.off_m <= RIGHT_M


def localised(
    recognizer: PlaceRecognizer, asked: Iterable[Shown], true: Sequence[Pose]
) -> Outcome:
    """Feed frames until the robot is localised."""
    metres, before = 0.0, true[0]
    for number, ((frame, descriptor), here) in enumerate(zip(asked, true, strict=False), 1):
        metres, before = metres + math.dist(here.position, before.position), here
        now = recognizer.process(frame, descriptor).localization
        if now and now.state is LocalizationState.LOCALISED and now.reference_index is not None:
            place = recognizer.reference_map.places[now.reference_index].pose
            off_m = math.dist(place.position, here.position) if place else math.inf
            return Outcome(number, metres, off_m, now.quality or 0.0)
    return Outcome(None, metres)


def poses(shown: Sequence[Shown]) -> list[Pose]:
    """Return where frames were taken."""
    return [frame.pose for frame, _ in shown if frame.pose]


def starts(recognizer: PlaceRecognizer, shown: Sequence[Shown], count: int) -> list[Outcome]:
    """Return what becomes of so many starts."""
    found = []
    for number, begin in enumerate(
        np.random.default_rng(0).integers(0, len(shown) - PATIENCE, count).tolist()
    ):
        recognizer.reset()
        part = shown[begin : begin + PATIENCE]
        odometer = Odometer(replace(DRIFT, seed=number))
        found.append(localised(recognizer, with_odometry(part, odometer), poses(part)))
    return found


def kidnappings(
    recognizer: PlaceRecognizer, shown: Sequence[Shown], count: int
) -> list[tuple[int | None, Outcome]]:
    """Return keyframes until it was noticed, and what became of the start elsewhere."""
    rng, found = np.random.default_rng(1), []
    while len(found) < count:
        first, second = rng.integers(0, len(shown) - max(BEFORE, AFTER), 2).tolist()
        away = shown[second : second + AFTER]
        last, there = poses(shown[first + BEFORE - 1 : first + BEFORE])[0], poses(away)
        if math.dist(last.position, there[0].position) < APART_M:
            continue
        odometer = Odometer(replace(DRIFT, seed=len(found)))
        recognizer.reset()
        start_ns = shown[first][0].stamp_ns
        both = [*shown[first : first + BEFORE], *away]
        stamped = [
            (replace(one, stamp_ns=start_ns + index * 10**8), descriptor)
            for index, (one, descriptor) in enumerate(both)
        ]
        here = localised(recognizer, with_odometry(stamped[:BEFORE], odometer), poses(both))
        for frame, descriptor in with_odometry(stamped[here.frames or BEFORE : BEFORE], odometer):
            recognizer.process(frame, descriptor)
        if recognizer.localizer.localization.state is not LocalizationState.LOCALISED:
            continue
        odometer.lift()
        noticed = None
        for number, (frame, descriptor) in enumerate(with_odometry(stamped[BEFORE:], odometer), 1):
            match = recognizer.process(frame, descriptor)
            if match.localization and match.localization.state is not LocalizationState.LOCALISED:
                noticed = number
                break
        rest = stamped[BEFORE + (noticed or AFTER) :]
        then = localised(recognizer, with_odometry(rest, odometer), there[noticed or 0 :] or there)
        frames = None if then.frames is None else then.frames + (noticed or 0)
        found.append((noticed, replace(then, frames=frames)))
    return found


def gardens_point(folder: Path) -> None:
    """Print the starts of Gardens Point: each of 196 frames and the four after it."""
    grays = {
        name: [frame.gray for frame in open_source(folder / name)]
        for name in ('day_left', 'day_right')
    }
    sides = {
        name: [Frame((index + 1) * 10**9, gray) for index, gray in enumerate(images)]
        for name, images in grays.items()
    }
    recognizer = PlaceRecognizer(build_map(sides['day_right']))
    numbers = [place.stamp_ns // 10**9 - 1 for place in recognizer.reference_map.places]
    shown = [
        (frame, describe(frame.gray)) for frame in sides['day_left'] if frame.gray is not None
    ]
    right = wrong = 0
    quality = 0.0
    for begin in range(len(shown) - 4):
        recognizer.reset()
        for number, (frame, descriptor) in enumerate(shown[begin : begin + 5], begin):
            now = recognizer.process(frame, descriptor).localization
            if now and now.state is LocalizationState.LOCALISED:
                is_right = abs(numbers[now.reference_index or 0] - number) <= RIGHT_FRAMES
                right, wrong = right + is_right, wrong + (not is_right)
                quality += now.quality or 0.0
                break
    count = len(shown) - 4
    print(
        f'Gardens Point, {count} starts, 5 frames: right {right / count:.3f}, wrong {wrong}, '
        f'quality {quality / max(1, right + wrong):.2f}'
    )


def told(name: str, outcomes: Sequence[Outcome]) -> None:
    """Print a row of starts."""
    known = [one for one in outcomes if one.frames is not None]
    right = [one for one in known if one.is_right]
    share = len(right) / len(outcomes)
    frames, metres, off_m = (
        np.median([getattr(one, what) for one in right]) if right else math.nan
        for what in ('frames', 'metres', 'off_m')
    )
    quality = np.mean([one.quality for one in known]) if known else math.nan
    print(
        f'{name:38}{len(outcomes):7}{share:8.3f}{len(known) - len(right):7}{frames:8.0f}'
        f'{metres:8.1f}{off_m:8.2f}{quality:9.2f}',
        flush=True,
    )


def said(text: str) -> None:
    print(f'{text} ...', file=sys.stderr, flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--data', type=Path, help='folder that holds gardens_point')
    parser.add_argument('--starts', type=int, default=200)
    parser.add_argument('--frames', type=int, default=10_000, help='of every drive')
    chosen = parser.parse_args()
    begun_s = time.monotonic()
    config = Config()
    recognizer = PlaceRecognizer(
        build_map((one for one, _ in driven(7, 'day', 0.0, 0.0, chosen.frames)), config=config)
    )
    recognizer.matcher.warm_up()
    print(f'{len(recognizer.reference_map)} places; {PATIENCE} frames a start')
    print(
        f'{"":38}{"starts":>7}{"right":>8}{"wrong":>7}{"frames":>8}{"metres":>8}{"off m":>8}'
        f'{"quality":>9}'
    )
    evening = driven(7, 'evening', ASIDE_M, 0.0, chosen.frames)
    told('evening, up to 2 m aside', starts(recognizer, evening, chosen.starts))
    night = driven(7, 'night', ASIDE_M, 8.0, chosen.frames)
    told('night and noise, up to 2 m aside', starts(recognizer, night, chosen.starts))
    count = chosen.starts // 4
    for light, shown in (('evening', evening), ('night', night)):
        taken = kidnappings(recognizer, shown, count)
        noticed = sum(frames is not None and frames <= 5 for frames, _ in taken) / count
        told(f'{light}: {count} kidnappings, found again', [outcome for _, outcome in taken])
        print(f'{"  lost noticed within 5 frames":38}{noticed:15.3f}')
    elsewhere = driven(99, 'evening', ASIDE_M, 0.0, min(chosen.frames, 420))
    outside = starts(recognizer, elsewhere, chosen.starts // 2)
    localised_there = sum(one.frames is not None for one in outside)
    print(f'{"outside the map":38}{len(outside):7}  localised: {localised_there}')
    if chosen.data:
        gardens_point(chosen.data / 'gardens_point')
    said(f'{time.monotonic() - begun_s:.0f} s')


if __name__ == '__main__':
    main()
