# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that is ended by a signal while frames come, and started again, on one growing map."""

from collections.abc import Iterator
from pathlib import Path
import random
import signal

from convseq_ros.core.map.reader import open_map

from bench.torture import corpus
from bench.torture.attack import Try
from bench.torture.robot import image, robot

ABOUT = 'SIGINT or SIGTERM while frames come at any rate, then a start on the same growing map'
ORACLE = 'exit 0 within 3 s; the map opens, and holds every place that it held before'
COUNT, PORTION, SHORT, SEED = 200, 10, 0, 16
_MOST_S = 3.0


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Start, send some frames, and end it."""
    draw = random.Random(seed)
    path, held, stamp_ns = folder / 'map.db', 0, 10**18
    for number in range(count):
        which = draw.choice((signal.SIGINT, signal.SIGTERM))
        frames = draw.randrange(40)
        with robot(
            folder,
            mode='online',
            map_path=path,
            keyframe_overlap=1.0,
            image_size_px=256,
            result_file=folder / 'result.csv',
        ) as one:
            for index in range(frames):
                stamp_ns += 10**8
                one.camera.publish(image(corpus.gray(number * 40 + index), stamp_ns))
                one.spin(draw.choice((0.0, 0.02)))
            one.process.send_signal(which)
            in_time = one.wait_for(lambda: one.process.poll() is not None, _MOST_S)
            code = one.process.poll()
        problem = ''
        if not in_time or code:
            problem = f'exit {code}' if in_time else f'did not end within {_MOST_S:g} s'
        places = len(open_map(path).places)
        if places < held:
            problem = f'{places} places, {held} before'
        held = places
        yield Try(f'{number}: {which.name} after {frames} frames', problem)
