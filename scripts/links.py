# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how well maps are linked, how far they grow, and what their links do for poses.

Usage: python scripts/links.py --data FOLDER [--part laps town round poses size], some 30 minutes
for all; FOLDER holds `laps`. `laps`: links of the map of a circuit that is driven in laps, and
its recall, with the truth of laps.py. `town`: a drawn way passed in the evening, by day and at
night, in one session and in three. `round`: a drawn round, driven 34 times in online mode.
`poses`: a drawn town whose odometry drifts by 2 %, solved. `size`: a map of 10,000 keyframes. Of
drawn ways, right is within 5 m of where the camera is.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from multiprocessing import Process
from pathlib import Path
import resource
import sys
import tempfile
import time

from convseq_ros import build_map, cli, Frame
from convseq_ros.config import make_config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map_builder import MapBuilder
from convseq_ros.core.session import Session
from convseq_ros.core.types import Pose
from convseq_ros.simulation.route import Corner, Route
from convseq_ros.sources.folder import ImageFolder
from convseq_ros.sources.recording import read_poses
from drives import away_m, head, lanes, options, PASSED_OVER, RIGHT_M, row, shots
import laps
import numpy as np

STEP_M = 2.0
PASS_NS = 10**11 * 3  # from the start of one pass to that of the next
LIGHTS = ('day', 'evening', 'night', 'overcast')
BEGINNING = 15  # keyframes of a round that do not count
HALF = 2996  # the last frame of the map of `laps`, by its name
SIZE = 10_000  # keyframes of a large map
SHAPE = 120, 160  # of an image, pixels
PIXELS = SHAPE[0] * SHAPE[1]


def ring(width_m: float, depth_m: float, town: int) -> Route:
    """Return a way once round a block."""
    corners: tuple[Corner, ...] = (
        (10.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m), (0.0, 0.0), (10.0, 0.0),
    )  # fmt: skip
    return Route(corners, town)


def driven(route: Route, number: int, light: str) -> Iterator[tuple[Frame, Pose]]:
    """Yield the frames of a pass by its number, and where they were taken."""
    drawn = shots(
        route, num_frames=int((route.length_m - 1) / STEP_M), speed_mps=10 * STEP_M,
        start_m=0.13 * (number % 10), start_ns=number * PASS_NS, light=light, noise=3.0,
        lanes=lanes(route.length_m, -1.0, 1.0, np.random.default_rng(number)), seed=number,
        width_px=SHAPE[1], height_px=SHAPE[0],
    )  # fmt: skip
    for _, frame in drawn:
        yield replace(frame, pose=None), frame.pose


def of_laps(data: Path) -> None:
    """Print links of one drive in laps, and what they do for later laps."""
    config = make_config({'exclusion_s': laps.EXCLUSION_S})
    drive = [*ImageFolder(data / 'laps' / 'drive')]
    truth = laps.read_truth(data / 'laps' / 'ground_truth.csv')
    where = {frame.stamp_ns: laps.place(truth, laps.number(frame)) for frame in drive}
    of = {frame.stamp_ns: laps.number(frame) for frame in drive}
    made = build_map(drive, None, config)
    links = {link.place: link for link in made.links.each()}
    there = right = wrong = 0
    for at, place in enumerate(made.places):
        here = where[place.stamp_ns]
        if here is None or of[place.stamp_ns] <= laps.FIRST_LAP:
            continue
        until_ns = place.stamp_ns - round(laps.EXCLUSION_S * 1e9)
        before = (where[one.stamp_ns] for one in made.places[:at] if one.stamp_ns <= until_ns)
        known = any(one is not None and laps.off(one, here) <= laps.RIGHT for one in before)
        there += known
        if at in links and (found := where[made.places[links[at].other].stamp_ns]) is not None:
            right += known and laps.off(found, here) <= laps.RIGHT
            wrong += laps.off(found, here) > laps.WRONG
    print(f'laps, links: {right} of {there}, {right / there:.3f}; {wrong} wrong')
    for name, last in (('one lap', laps.FIRST_LAP), (f'frames up to {HALF}', HALF)):
        mapped = [frame for frame in drive if laps.number(frame) <= last]
        asked = [frame for frame in drive if laps.number(frame) > HALF]
        counts = laps.count(mapped, asked, where, config)
        told = f'{counts.right} of {counts.known}, {counts.right / counts.known:.3f}'
        print(f'laps, map of {name}, the rest as query: {told}; {counts.wrong} wrong', flush=True)


def of_town(_data: Path) -> None:
    """Print what is linked of three passes, in one session and in three."""
    config, route = make_config({'exclusion_s': 30.0}), ring(150.0, 100.0, 5)
    found = dict[int, dict[int, int]]()
    for sessions in (1, 3):
        true = dict[int, Pose]()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, 'town.db')
            builder = MapBuilder(path, config)
            for number, light in enumerate(('evening', 'day', 'night')):
                if number and sessions > 1:
                    builder.__exit__()
                    builder = MapBuilder(path, config, append=True)
                for frame, pose in driven(route, number, light):
                    true[frame.stamp_ns] = pose
                    builder.process(frame)
            builder.__exit__()
            made = open_map(path)
        found[sessions] = _links(made)
        later = [place.stamp_ns for place in made.places if place.stamp_ns >= PASS_NS]
        right, wrong = _judged(found[sessions], true)
        print(
            f'town, {sessions} sessions: {right} of {len(later)} keyframes linked, '
            f'{right / len(later):.3f}; {wrong} wrong',
            flush=True,
        )
    both = found[1].keys() & found[3].keys()
    alike = sum(found[1][one] == found[3][one] for one in both)
    print(f'town, linked in both ways: {len(both)}, of which {alike} to the same keyframe')


def _links(made: ReferenceMap) -> dict[int, int]:
    """Return what each keyframe is linked to, by stamps."""
    stamp = [place.stamp_ns for place in made.places]
    return {stamp[link.place]: stamp[link.other] for link in made.links.each()}


def _judged(links: dict[int, int], true: dict[int, Pose]) -> tuple[int, int]:
    right = sum(away_m(true[one], true[two]) <= RIGHT_M for one, two in links.items())
    return right, len(links) - right


def of_round(_data: Path, rounds: int = 34, max_looks: int = 8) -> None:
    """Print how a map grows that a robot drives the same round with again and again."""
    config = make_config({'mode': 'online', 'max_looks': max_looks, 'exclusion_s': 6.0})
    route, true, first = ring(60.0, 40.0, 3), dict[int, Pose](), 0
    head('round', 'light', 'right of keyframes', 'false', 'added', 'left', 'times one round')
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'round.db')
        for number in range(rounds):
            some = np.random.default_rng(number).choice(LIGHTS)
            light = LIGHTS[number] if number < len(LIGHTS) else str(some)
            session, found = Session(path, config), list[bool | None]()
            for frame, pose in driven(route, number, light):
                true[frame.stamp_ns] = pose
                match = session.recognizer.process(frame)
                session.save()
                if match.reason in PASSED_OVER:
                    continue
                there = match.accepted and true[match.accepted.reference_stamp_ns]
                found.append(away_m(there, pose) <= RIGHT_M if there else None)
            session.close()
            places, later = len(open_map(path)), found[BEGINNING:]
            first = first or places
            right = f'{later.count(True)} of {len(later)}'
            grown = session.added, places, f'{places / first:.1f}'
            row(number + 1, light, right, found.count(False), *grown)


def of_poses(_data: Path) -> None:
    """Print the error of a trajectory whose odometry drifts, before and after it is solved."""
    examples = Path(__file__).resolve().parents[1] / 'examples' / 'pose_graph'
    sys.path.insert(0, str(examples))
    import gtsam
    import simulated
    from trajectory_error import absolute_error_m

    for scale in (simulated.DRIFT.scale, 0.02):
        simulated.DRIFT = replace(simulated.DRIFT, scale=scale)
        with tempfile.TemporaryDirectory() as folder:
            town, made, solved, graph = (
                Path(folder, name) for name in ('town', 'town.db', 'solved.db', 'town.g2o')
            )
            simulated.record(town, simulated.two_blocks(110.0, 70.0))
            camera = '--odom', '/odom', '--camera-info', '/camera/camera_info'
            outputs = '--g2o', graph, '-o', solved
            for command in (('build-map', town, made, *camera), ('map', 'link', made, *outputs)):
                if cli.main([*map(str, command)]):
                    raise SystemExit(1)
            true = dict(read_poses(town, '/ground_truth'))
            for name, path in (('odometry', made), ('solved', solved)):
                places = [place for place in open_map(path).places if place.pose]
                points = [place.pose.position[:2] for place in places if place.pose]
                really = [true[min(true, key=lambda at: abs(at - one.stamp_ns))] for one in places]
                real = np.array([pose.position[:2] for pose in really])
                error_m = absolute_error_m(np.array(points), real)
                print(f'poses, odometry {scale:.1%} too long, {name}: {error_m:.2f} m', flush=True)
            edges, poses = gtsam.readG2o(str(graph), True)
            print(
                f"poses, read back by GTSAM's reader: {edges.size()} edges, {poses.size()} poses"
            )


def of_size(_data: Path) -> None:
    """Print what a large map with links takes: a ring in four lights, again and again."""
    config = make_config({'exclusion_s': 30.0})
    spent_s, reported, rng = 0.0, 0, np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder, 'drawn')
        drawing = Process(target=_draw, args=(drawn,))  # whose memory does not count
        drawing.start()
        drawing.join()
        images = drawn.stat().st_size // PIXELS
        with MapBuilder(Path(folder, 'large.db'), config) as builder:
            made = builder.reference_map
            for number in count():
                at = number % images * PIXELS
                image = np.fromfile(drawn, np.uint8, PIXELS, offset=at).reshape(SHAPE)
                gray = np.clip(image + rng.integers(-8, 9, SHAPE), 0, 255).astype(np.uint8)
                began_s = time.process_time()
                builder.process(Frame(number * 10**8, gray))
                spent_s += time.process_time() - began_s
                if len(made) >= reported + SIZE // 20:
                    reported = len(made)
                    resident_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
                    print(
                        f'size: {reported} keyframes, {len(made.links)} links, '
                        f'{1000 * spent_s / (number + 1):.1f} ms a frame, {resident_mb:.0f} MB',
                        flush=True,
                    )
                if len(made) >= SIZE:
                    break


def _draw(path: Path) -> None:
    route = ring(150.0, 100.0, 5)
    passes = [driven(route, number, light) for number, light in enumerate(LIGHTS)]
    np.array([frame.gray for one in passes for frame, _ in one]).tofile(path)


PARTS: dict[str, Callable[[Path], None]] = {
    'laps': of_laps, 'town': of_town, 'round': of_round, 'poses': of_poses, 'size': of_size,
}  # fmt: skip


def main() -> None:
    """Measure, and print."""
    chosen = options(__doc__, data=None, part=[*PARTS])
    for part in chosen.part:
        PARTS[part](chosen.data)


if __name__ == '__main__':
    main()
