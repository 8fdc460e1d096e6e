# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the quality of map links, and the growth of maps.

Usage: python scripts/links.py [--data FOLDER] [--part laps town round], up to 30 minutes for all.
FOLDER holds `laps`; without it that part is left out.
`laps`: links and recall of the map of a circuit that is driven in laps, with the truth of laps.py.
`town`: a drawn route driven in the evening, by day and at night, in one session and in three.
`round`: a drawn round, driven 34 times in online mode.
On drawn routes, a link is right within 5 m of the camera's position.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
import tempfile

from convseq_ros import build_map, Config, Frame
from convseq_ros.app.map_builder import MapBuilder
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config import make_config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.types import Pose
from convseq_ros.simulation.route import Corner, Route
from convseq_ros.sources.folder import ImageFolder
from drives import away_m, head, lanes, options, PASSED_OVER, progress, RIGHT_M, row, shots
import laps
import numpy as np

STEP_M = 2.0
PASS_NS = 10**11 * 3  # between the starts of two passes
LIGHTS = ('day', 'evening', 'night', 'overcast')
PASSES = ('evening', 'day', 'night')  # of the town
ROUNDS = 34
BEGINNING = 15  # keyframes of a round that are not counted
HALF = 2996  # the last frame of the map of `laps`, by its name


def ring(width_m: float, depth_m: float, town: int) -> Route:
    """Return a route once round a block."""
    corners: tuple[Corner, ...] = (
        (10.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m), (0.0, 0.0), (10.0, 0.0),
    )  # fmt: skip
    return Route(corners, town)


def driven(route: Route, number: int, light: str) -> Iterator[tuple[Frame, Pose]]:
    """Yield the frames of a pass, with their true poses."""
    drawn = shots(
        route, num_frames=int((route.length_m - 1) / STEP_M), speed_mps=10 * STEP_M,
        start_m=0.13 * (number % 10), start_ns=number * PASS_NS, light=light, noise=3.0,
        lanes=lanes(route.length_m, -1.0, 1.0, np.random.default_rng(number)), seed=number,
        width_px=160, height_px=120,
    )  # fmt: skip
    for _, frame in drawn:
        yield replace(frame, pose=None), frame.pose


def of_laps(data: Path) -> None:
    """Print the links of a drive in laps, and the recall of later laps."""
    config = Config()
    drive = [*ImageFolder(data / 'laps' / 'drive')]
    truth = laps.read_truth(data / 'laps' / 'ground_truth.csv')
    where = {frame.stamp_ns: laps.place(truth, laps.number(frame)) for frame in drive}
    of = {frame.stamp_ns: laps.number(frame) for frame in drive}
    built = build_map(drive, None, config)
    links = {link.place: link for link in built.links.each()}
    there = right = wrong = 0
    for at, place in enumerate(built.places):
        here = where[place.stamp_ns]
        if here is None or of[place.stamp_ns] <= laps.FIRST_LAP:
            continue
        until_ns = place.stamp_ns - round(laps.KNOWN_AFTER_S * 1e9)
        before = (where[one.stamp_ns] for one in built.places[:at] if one.stamp_ns <= until_ns)
        known = any(at is not None and laps.off(at, here) <= laps.RIGHT for at in before)
        there += known
        if at in links and (linked := where[built.places[links[at].other].stamp_ns]) is not None:
            right += known and laps.off(linked, here) <= laps.RIGHT
            wrong += laps.off(linked, here) > laps.WRONG
    print(f'laps, links: {right} of {there}, {right / there:.3f}; {wrong} wrong')
    for name, last in (('one lap', laps.FIRST_LAP), (f'frames up to {HALF}', HALF)):
        mapped = [frame for frame in drive if laps.number(frame) <= last]
        queries = [frame for frame in drive if laps.number(frame) > HALF]
        counts = laps.count(mapped, queries, where, config)
        ratio = f'{counts.right} of {counts.known}, {counts.right / counts.known:.3f}'
        print(f'laps, map of {name}, the rest as query: {ratio}; {counts.wrong} wrong', flush=True)


def of_town(_data: Path) -> None:
    """Print the links of three passes, in one session and in three."""
    config, route = Config(), ring(150.0, 100.0, 5)
    links_by_sessions = []
    for sessions in ((0, 1, 2),), ((0,), (1,), (2,)):
        true = dict[int, Pose]()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, 'town.db')
            for session in sessions:
                with MapBuilder(path, config, append=path.exists()) as builder:
                    for number in session:
                        for frame, pose in driven(route, number, PASSES[number]):
                            true[frame.stamp_ns] = pose
                            builder.process(frame)
            reference_map = open_map(path)
        stamps = [place.stamp_ns for place in reference_map.places]
        links = {stamps[link.place]: stamps[link.other] for link in reference_map.links.each()}
        later = sum(stamp_ns >= PASS_NS for stamp_ns in stamps)
        right = sum(away_m(true[one], true[two]) <= RIGHT_M for one, two in links.items())
        print(
            f'town, {len(sessions)} sessions: {right} of {later} keyframes linked, '
            f'{right / later:.3f}; {len(links) - right} wrong',
            flush=True,
        )
        links_by_sessions.append(links)
    both = links_by_sessions[0].keys() & links_by_sessions[1].keys()
    same = sum(links_by_sessions[0][one] == links_by_sessions[1][one] for one in both)
    print(f'town, linked in both ways: {len(both)}, {same} of them to the same keyframe')


def of_round(_data: Path) -> None:
    """Print the growth of an online map over many drives of the same round."""
    config = make_config({'mode': 'online'})
    route, true, first = ring(60.0, 40.0, 3), dict[int, Pose](), 0
    head('round', 'light', 'right of keyframes', 'false', 'added', 'left', 'times one round')
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'round.db')
        for number in range(ROUNDS):
            random_light = np.random.default_rng(number).choice(LIGHTS)
            light = LIGHTS[number] if number < len(LIGHTS) else str(random_light)
            pipeline, verdicts = Pipeline(path, config), list[bool | None]()
            for frame, pose in driven(route, number, light):
                true[frame.stamp_ns] = pose
                match = pipeline.recognizer.process(frame)
                pipeline.save()
                if match.reason in PASSED_OVER:
                    continue
                there = match.accepted and true[match.accepted.reference_stamp_ns]
                verdicts.append(away_m(there, pose) <= RIGHT_M if there else None)
            pipeline.close()
            places, later = len(open_map(path)), verdicts[BEGINNING:]
            first = first or places
            right = f'{later.count(True)} of {len(later)}'
            grown = pipeline.added, places, f'{places / first:.1f}'
            row(number + 1, light, right, verdicts.count(False), *grown)


PARTS: dict[str, Callable[[Path], None]] = {'laps': of_laps, 'town': of_town, 'round': of_round}


def main() -> None:
    """Measure, and print."""
    chosen = options(__doc__, data=None, part=[*PARTS])
    for part in chosen.part:
        if part == 'laps' and chosen.data is None:
            progress('laps is left out: it needs --data')
        else:
            PARTS[part](chosen.data)


if __name__ == '__main__':
    main()
