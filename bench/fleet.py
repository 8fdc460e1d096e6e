# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure a fleet: `python -m bench.fleet frames --places 100000` or `... build`.

`frames` makes maps in a temporary folder, 17 kB a place, and deletes them: one holds a drawn
street, which is driven again in the evening, the others its images mirrored, with other global
descriptors.
`build` draws short recordings and builds their maps on one worker and on two.
"""

import argparse
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, redirect_stdout
import json
import os
from pathlib import Path
import statistics
import sys
import tempfile
import time
from typing import Any

from convseq_ros import Config, Frame, PlaceRecognizer
from convseq_ros.cli import main as convseq
from convseq_ros.cli.fleet_build import build_one
from convseq_ros.config import EncodingConfig, EVERY_FRAME
from convseq_ros.core.map.place import Packed, Picture, Place, Places
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.sessions import MapSession
from convseq_ros.core.map.writer import MapWriter
from convseq_ros.core.types import Match, Status
from convseq_ros.fleet import shard
from convseq_ros.fleet.cluster import Cluster, connected, done
from convseq_ros.fleet.session import FleetSession
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
import cv2
import numpy as np

from bench import material

FIRST = 2000  # places of the map that holds the street; the others share the rest
FRAMES = 200  # of the drive through the street
WARM = 30  # first frames, which do not count: buffers and caches fill
KINDS = 2000  # places of the first map whose images others repeat
SPREAD = 0.02  # by which their global descriptors differ from those


def mirrored(known: ReferenceMap, indices: Sequence[int]) -> list[Packed]:
    """Return cells of places as a mirror shows them: of no place of the map."""
    return [np.flip(one, 1).copy() for one in known.packed_of(indices)]


def write_like(first: Path, path: Path, count: int, seed: int) -> int:
    """Write a map of so many places that look much like those of another map; return the count."""
    known, rng = open_map(first), np.random.default_rng(seed)
    kinds = rng.choice(len(known), min(KINDS, len(known)), replace=False).tolist()
    packed, descriptors = mirrored(known, kinds), known.global_descriptors[kinds]
    part = path.with_suffix('.part')
    part.unlink(missing_ok=True)
    with MapWriter(part, EncodingConfig(), EVERY_FRAME) as writer:
        for index in range(count):
            like = index % len(kinds)
            noise = rng.standard_normal(descriptors.shape[1], np.float32)
            descriptor = descriptors[like] + np.float32(SPREAD) * noise
            place = Place(index * 10**8, f'{seed}/{index:07}.png')
            writer.add(place, Picture(packed[like]), descriptor.astype(np.float16))
            if index % 1000 == 999:
                writer.commit()
    part.rename(path)
    return count


def open_thin(first: Path, count: int) -> None:
    """Have this process open maps of so many places that have no file, but cells of the first."""
    known = open_map(first)
    cells = mirrored(known, range(KINDS))

    def opened(path: Path) -> ReferenceMap:
        if not path.name.startswith('thin-'):
            return open_map(path)
        rng = np.random.default_rng(int(path.stem[5:]))
        places = Places(known.global_descriptors.shape[1], count)
        kinds = rng.permutation(KINDS)
        for start in range(0, count, KINDS):
            some = known.global_descriptors[kinds[: count - start]]
            noise = np.float32(SPREAD) * rng.standard_normal(some.shape, np.float32)
            rows = (
                (at, at * 10**8, f'{path.stem}/{at:07}.png', *[None] * 7, 0, one.tobytes(), 0)
                for at, one in enumerate((some + noise).astype(np.float16), start)
            )
            places.extend([*rows])
        sessions = [MapSession(path.name, path.stem, 0)]

        def pictures(indices: Sequence[int], _with_images: bool = False) -> list[Picture]:
            return [Picture(cells[kinds[index % KINDS]]) for index in indices]

        return ReferenceMap(known.encoding, places, pictures, known.keyframes, sessions=sessions)

    shard.open_map = opened


def resident_mb() -> float:
    """Return how much memory this process has."""
    pages = int(Path('/proc/self/statm').read_text(encoding='ascii').split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


def said(match: Match) -> tuple[Any, ...]:
    """Return what a match says that must not depend on where its map is."""
    known = match.status, match.reason, match.candidates, match.sequence_length
    return *known, match.pairs_scored, match.confidence, match.localization


def frames(chosen: argparse.Namespace, folder: Path) -> Mapping[str, Any]:
    """Measure frames through a fleet."""
    each = (chosen.places - FIRST) // (chosen.maps - 1)
    material.prepare(folder, (FIRST,), FRAMES)
    first = material.map_path(folder, FIRST)
    paths = [folder / f'other-{number}.db' for number in range(1, chosen.maps)]
    jobs = {path.name: (first, path, each, at) for at, path in enumerate(paths)}
    jobs = {name: job for name, job in jobs.items() if not job[1].exists()}
    if chosen.thin:
        paths, jobs = [folder / f'thin-{number}.db' for number in range(1, chosen.maps)], {}
        for path in paths:  # holes, as large as a map: by size, maps are shared out
            path.touch()
            os.truncate(path, each * first.stat().st_size // FIRST)
    if jobs:
        with connected(Cluster(workers=chosen.workers)) as client:
            for name, _ in done(client, write_like, jobs):
                print(name, file=sys.stderr)
    if chosen.draw_only:
        return {}
    one = None
    if chosen.beside:
        merged = folder / 'merged' / 'merged.db'
        merged.parent.mkdir(exist_ok=True)
        if not merged.exists():
            names = [str(path) for path in (first, *paths)]
            with redirect_stdout(sys.stderr):
                convseq(['map', 'merge', *names, '-o', str(merged), '--no-links'])
        one = PlaceRecognizer(open_map(merged), Config())
    with connected(Cluster(workers=chosen.workers, are_threads=chosen.threads)) as client:
        before = client.run(resident_mb)
        if chosen.thin:
            client.run(open_thin, first, each)
        started = time.monotonic()
        session = FleetSession(client, [first, *paths], Config(), 300.0)
        opened_s = time.monotonic() - started
        read, rounds, ask_some = [0], [0], session.fleet._ask_some

        def asked(method, what):
            rounds[0] += 1
            if method == 'pictures':
                read[0] += sum(len(some) for _, (own, _) in what for some in own.values())
            return ask_some(method, what)

        session.fleet._ask_some = asked
        took_ms, right, accepted, beside_ms, differ = [], 0, 0, [], 0
        for index, gray in enumerate(material.read_queries(folder)):
            started = time.perf_counter()
            match = session.recognizer.process(Frame(index * 10**8, gray))
            took_ms.append(1e3 * (time.perf_counter() - started))
            if one:
                started = time.perf_counter()
                other = one.process(Frame(index * 10**8, gray))
                beside_ms.append(1e3 * (time.perf_counter() - started))
                differ += said(match) != said(other)
            if index == WARM:
                read[0] = rounds[0] = 0
                busy_s = client.run(time.process_time), time.process_time()
            if match.status is Status.ACCEPTED and match.best:
                accepted += 1
                off = abs(match.best.reference_index - material.truth(index, FIRST, FRAMES))
                right += off <= 2
        count = len(took_ms) - WARM - 1
        here_s = time.process_time() - busy_s[1]
        workers_s = [then - busy_s[0][one] for one, then in client.run(time.process_time).items()]
        beside = {}
        if one:
            ratios = [a / b for a, b in zip(took_ms, beside_ms, strict=True)]
            beside = {
                'differ': differ,
                'one_map_ms': statistics.median(beside_ms[WARM:]),
                'times_as_long': statistics.median(ratios[WARM:]),
            }
        return beside | {
            'places': session.fleet.count,
            'maps': chosen.maps,
            'workers': chosen.workers,
            'opened_s': opened_s,
            'frame_ms': statistics.median(took_ms[WARM:]),
            'p95_ms': float(np.percentile(took_ms[WARM:], 95)),
            'here_busy_ms': 1e3 * here_s / count,  # of a processor's time, a frame
            'workers_busy_ms': [1e3 * one / count for one in workers_s],
            'rounds_a_frame': rounds[0] / count,
            'places_read_a_frame': read[0] / count,
            'worker_mb': max(client.run(resident_mb).values()),
            'empty_worker_mb': max(before.values()),
            'here_mb': resident_mb(),
            'accepted': accepted,
            'right': right,
            'frames': len(took_ms),
        }


def build(chosen: argparse.Namespace, folder: Path) -> Mapping[str, Any]:
    """Measure the same recordings on one worker and on some."""
    for number in range(chosen.recordings):
        own = folder / 'recordings' / f'drive_{number:02}'
        if own.exists():
            continue
        own.mkdir(parents=True)
        street = Street(length_m=chosen.images + 60, seed=number)
        for at, shot in enumerate(draw(street, Drive(num_frames=chosen.images, seed=number))):
            cv2.imwrite(str(own / f'{at:03}.png'), shot.image)
    if chosen.draw_only:
        return {}
    took_s, busy_s = {}, {}
    for workers in (1, chosen.workers, 1, chosen.workers):
        maps = Path(tempfile.mkdtemp(dir=folder))
        with connected(Cluster(workers=workers)) as client:
            client.run(resident_mb)  # both are there
            jobs = {
                path.name: (path, maps / f'{path.name}.db', *[''] * 4, Config())
                for path in sorted((folder / 'recordings').iterdir())
            }
            # Once for imports and kernels of each worker.
            warm = {name: (path, maps / f'warm-{name}.db', *rest)
                    for name, (path, _, *rest) in [*jobs.items()][: 2 * workers]}  # fmt: skip
            [*done(client, build_one, warm)]
            before, started = client.run(time.process_time), time.monotonic()
            [*done(client, build_one, jobs)]
            took_s.setdefault(workers, []).append(time.monotonic() - started)
            after = client.run(time.process_time)
            busiest_s = max(after[worker] - before[worker] for worker in before)
            busy_s.setdefault(workers, []).append(busiest_s)
    alone, together = (min(took_s[workers]) for workers in (1, chosen.workers))
    busy_alone, busy_together = (min(busy_s[workers]) for workers in (1, chosen.workers))
    return {
        'recordings': chosen.recordings,
        'images': chosen.recordings * chosen.images,
        'seconds': took_s,
        'workers': chosen.workers,
        'times_faster': alone / together,
        # Of a processor's time that the busiest worker takes: without others on the machine.
        'busiest_s': busy_s,
        'busiest_times_faster': busy_alone / busy_together,
    }


def main() -> int:
    """Measure one of the two and print it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('what', choices=['frames', 'build'])
    parser.add_argument('--places', type=int, default=100_000)
    parser.add_argument('--maps', type=int, default=10)
    parser.add_argument('--recordings', type=int, default=20)
    parser.add_argument('--images', type=int, default=40, help='of a recording')
    parser.add_argument('--workers', type=int, default=2)
    parser.add_argument(
        '--beside', action='store_true', help='ask one merged map the same, frame by frame'
    )
    parser.add_argument(
        '--thin', action='store_true', help='frames: no files but of the first map'
    )
    parser.add_argument('--threads', action='store_true', help='frames: workers of this process')
    parser.add_argument('--folder', type=Path, help='for the maps, which are kept then')
    parser.add_argument('--draw-only', action='store_true', help='make the maps, measure later')
    chosen = parser.parse_args()
    with ExitStack() as opened:
        folder = chosen.folder or Path(
            opened.enter_context(tempfile.TemporaryDirectory(prefix='convseq_fleet_'))
        )
        folder.mkdir(parents=True, exist_ok=True)
        print(json.dumps({'frames': frames, 'build': build}[chosen.what](chosen, folder)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
