# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map that grows on a disk that is slow to sync."""

from collections.abc import Iterator
from pathlib import Path
import random
import signal

from convseq_ros.core.map.reader import open_map

from bench.torture import corpus, disk
from bench.torture.attack import Try
from bench.torture.robot import greet, image, robot

ABOUT = (
    'A map grows by 10 places a second while every sync of the disk takes up to .1, .3 or 1 s '
    'longer, as on a worn card; after 40 frames SIGTERM or SIGKILL'
)
ORACLE = (
    'every frame is answered within a second; after SIGTERM exit 0 within 15 s and all places are '
    'in the file, after SIGKILL those that the node called kept'
)
COUNT, PORTION, SHORT, SEED = 20, 5, 0, 16
_FRAMES, _PERIOD_S = 40, 0.1
_ANSWER_S, _TOLD_S, _END_S = 1.0, 0.6, 15.0


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Let a map grow, and end the node."""
    draw = random.Random(seed)
    library = disk.environment(folder)['LD_PRELOAD']
    for number in range(count):
        most_ms, which = (
            draw.choice((100, 300, 1000)),
            draw.choice((signal.SIGTERM, signal.SIGKILL)),
        )
        problem = _grow(folder, library, most_ms, which, number)
        yield Try(f'{number}: {which.name}, syncs of {most_ms} ms', problem)


def _grow(folder: Path, library: str, most_ms: int, which: signal.Signals, number: int) -> str:
    """Return what did not hold."""
    path = folder / f'{number}.db'
    slow = {'LD_PRELOAD': library, 'DISK_SLOW_MS': str(most_ms)}
    chosen = {'mode': 'online', 'map_path': path, 'diagnostics_period_s': 0.2}
    with robot(folder, slow, keyframe_overlap=1.0, image_size_px=256, **chosen) as one:
        greet(one)
        wanted = one.answers + _FRAMES
        for index in range(_FRAMES):
            stamp_ns = 10**18 + round(index * _PERIOD_S * 1e9)
            one.camera.publish(image(corpus.gray(number * _FRAMES + index), stamp_ns))
            one.spin(_PERIOD_S)
        if not one.wait_for(lambda: one.answers >= wanted, _ANSWER_S):
            return f'{wanted - one.answers} frames are not answered'
        one.spin(_TOLD_S)
        is_ended = which is signal.SIGTERM
        said = one.count('map_size' if is_ended else 'places_kept')
        one.process.send_signal(which)
        if not one.wait_for(lambda: one.process.poll() is not None, _END_S):
            return f'did not end within {_END_S:g} s'
        code = one.process.poll()
    if is_ended and code:
        return f'exit {code}'
    places = len(open_map(path))
    return f'{places} places, {said} were promised' if places < said else ''
