# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure a fleet: `python -m bench.fleet frames --places 100000` or `... build`.

`frames`: one map holds a drawn street, which is driven again in the evening. The other maps have
no content on disk. Their places are mirrored images of the first map, with other global
descriptors. `build` draws short recordings and builds their maps on one worker and on several.
"""

import argparse
from collections.abc import Mapping, Sequence
import json
import os
from pathlib import Path
import statistics
import sys
import tempfile
import time
from typing import Any

from convseq_ros import Config, Frame
from convseq_ros.cli.fleet import build_one
from convseq_ros.core.map.arrays import Places
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.place import Picture
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Status
from convseq_ros.fleet import shard
from convseq_ros.fleet.cluster import Cluster, connected, finished_jobs
from convseq_ros.fleet.fleet import Fleet
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
import cv2
import numpy as np

from bench import material

FIRST = 2000  # places of the map of the street; the other maps repeat its images
FRAMES = 200  # of the drive through the street
WARM = 30  # first frames, not counted: buffers and caches fill
SPREAD = 0.02  # deviation of the other maps' global descriptors


def open_thin(first: Path, count: int) -> None:
    """Let this process open maps of `count` places without content, with the first map's cells."""
    source = open_map(first)
    cells = [np.flip(packed, 1).copy() for packed in source.packed_of(range(FIRST))]

    def opened(path: str | Path, *_: Any, **__: Any) -> ReferenceMap:
        path = Path(path)
        if not path.name.startswith('thin-'):
            return open_map(path)
        rng, places = (
            np.random.default_rng(int(path.stem[5:])),
            Places(source.global_descriptors.shape[1], count),
        )
        kinds = rng.permutation(FIRST)
        for start in range(0, count, FIRST):
            descriptors = source.global_descriptors[kinds[: count - start]]
            noise = np.float32(SPREAD) * rng.standard_normal(descriptors.shape, np.float32)
            rows = (
                (at, at * 10**8, f'{path.stem}/{at:07}.png', *[None] * 7, 0, row.tobytes(), 0)
                for at, row in enumerate((descriptors + noise).astype(np.float16), start)
            )
            places.extend([*rows])
        sessions = [MapSession(path.name, path.stem, 0)]

        def pictures(indices: Sequence[int], _with_images: bool = False) -> list[Picture]:
            return [Picture(cells[kinds[index % FIRST]]) for index in indices]

        return ReferenceMap(source.encoding, places, pictures, source.keyframes, sessions=sessions)

    shard.open_map = opened


def frames(chosen: argparse.Namespace, folder: Path) -> Mapping[str, Any]:
    """Measure frames through a fleet."""
    each = (chosen.places - FIRST) // (chosen.maps - 1)
    material.prepare(folder, (FIRST,), FRAMES)
    first = material.map_path(folder, FIRST)
    paths = [folder / f'thin-{number}.db' for number in range(1, chosen.maps)]
    for path in paths:  # sparse files as large as a map: maps are distributed by size
        path.touch()
        os.truncate(path, each * first.stat().st_size // FIRST)
    with connected(Cluster(workers=chosen.workers, are_threads=chosen.threads)) as client:
        empty_mb = max(client.run(material.resident_mb).values())
        client.run(open_thin, first, each)
        started_s = time.monotonic()
        fleet = Fleet(client, [first, *paths], Config(), 300.0)
        opened_s = time.monotonic() - started_s
        took_ms, right, accepted = [], 0, 0
        for index, gray in enumerate(material.read_queries(folder)):
            if index == WARM:
                busy_s = client.run(time.process_time), time.process_time()
            start_s = time.perf_counter()
            match = fleet.cameras.first.process(Frame(index * 10**8, gray))
            took_ms.append(1e3 * (time.perf_counter() - start_s))
            if match.status is Status.ACCEPTED and match.best:
                accepted += 1
                off = abs(match.best.reference_index - material.truth(index, FIRST, FRAMES))
                right += off <= 2
        count, here_s = len(took_ms) - WARM, time.process_time() - busy_s[1]
        workers_s = [now - busy_s[0][name] for name, now in client.run(time.process_time).items()]
        return {
            'places': fleet.count,
            'maps': chosen.maps,
            'workers': chosen.workers,
            'opened_s': opened_s,
            'frame_ms': statistics.median(took_ms[WARM:]),
            'p95_ms': float(np.percentile(took_ms[WARM:], 95)),
            'here_busy_ms': 1e3 * here_s / count,  # CPU time per frame
            'workers_busy_ms': [1e3 * worker_s / count for worker_s in workers_s],
            'worker_mb': max(client.run(material.resident_mb).values()),
            'empty_worker_mb': empty_mb,
            'here_mb': material.resident_mb(),
            'accepted': accepted,
            'right': right,
            'frames': len(took_ms),
        }


def build(chosen: argparse.Namespace, folder: Path) -> Mapping[str, Any]:
    """Measure the same recordings on one worker and on several."""
    for number in range(chosen.recordings):
        recording = folder / 'recordings' / f'drive_{number:02}'
        recording.mkdir(parents=True)
        street = Street(length_m=chosen.images + 60, seed=number)
        for at, shot in enumerate(draw(street, Drive(num_frames=chosen.images, seed=number))):
            cv2.imwrite(str(recording / f'{at:03}.png'), shot.image)
    took_s: dict[int, list[float]] = {}
    for workers in (1, chosen.workers, 1, chosen.workers):
        maps = Path(tempfile.mkdtemp(dir=folder))
        with connected(Cluster(workers=workers)) as client:
            client.run(material.resident_mb)  # wait for all workers
            jobs = {
                path.name: (path, maps / f'{path.name}.db', Config())
                for path in sorted((folder / 'recordings').iterdir())
            }
            # A first run, for the imports and kernels of each worker.
            warm = {name: (path, maps / f'warm-{name}.db', *rest)
                    for name, (path, _, *rest) in [*jobs.items()][: 2 * workers]}  # fmt: skip
            [*finished_jobs(client, build_one, warm)]
            started_s = time.monotonic()
            [*finished_jobs(client, build_one, jobs)]
            took_s.setdefault(workers, []).append(time.monotonic() - started_s)
    return {
        'images': chosen.recordings * chosen.images,
        'seconds': took_s,
        'times_faster': min(took_s[1]) / min(took_s[chosen.workers]),
    }


def main() -> int:
    """Run one of the two measurements and print it as JSON."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument('what', choices=['frames', 'build'])
    parser.add_argument('--places', type=int, default=100_000)
    parser.add_argument('--maps', type=int, default=10)
    parser.add_argument('--recordings', type=int, default=20)
    parser.add_argument('--images', type=int, default=40, help='of a recording')
    parser.add_argument('--workers', type=int, default=2)
    parser.add_argument('--threads', action='store_true', help='frames: workers of this process')
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='convseq_fleet_') as folder:
        print(json.dumps({'frames': frames, 'build': build}[chosen.what](chosen, Path(folder))))
    return 0


if __name__ == '__main__':
    sys.exit(main())
