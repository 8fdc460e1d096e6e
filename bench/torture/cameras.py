# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bursts of images of any camera, and what they leave behind."""

from collections.abc import Iterator
from pathlib import Path
import random

import numpy as np

from bench.torture.attack import Try
from bench.torture.robot import greet, image, Robot, robot, unaccounted

ABOUT = '30 images at once of 640 x 480 to 7,680 x 4,320 px, gray or in colour'
ORACLE = (
    'every image is answered, or counted as dropped or lost; below 1.5 GB; 10 s later the node '
    'holds at most 256 MB more than before the first burst, which the middleware keeps, and '
    'one image'
)
COUNT, PORTION, SHORT, SEED = 20, 5, 0, 16
_SIZES = ((480, 640), (1_080, 1_920), (2_160, 3_840), (4_320, 7_680))
_BURST = 30
_MOST_MB, _MOST_LEFT_MB = 1_500, 256 + 100
_PATIENCE_S, _LEFT_S = 120.0, 10.0


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Send bursts, the first of which is small: it shows what the node needs for itself."""
    draw = random.Random(seed)
    if not count:
        return
    with robot(folder, mode='online', diagnostics_period_s=0.2) as one:
        greet(one)
        sent = 0
        before_mb = 0.0
        for number in range(count + 1):
            height, width = draw.choice(_SIZES) if number else _SIZES[0]
            channels = draw.choice((1, 3))
            noise = np.random.default_rng(number).integers(0, 256, (height, width), np.uint8)
            data = np.repeat(noise, channels, axis=1)
            kind = {'width': width, 'encoding': 'mono8' if channels == 1 else 'bgr8'}
            for _ in range(_BURST):
                sent += 1
                one.camera.publish(image(data, 10**18 + sent * 10**8, **kind))
            problem = _problem(one, sent)
            one.spin(_LEFT_S)
            left_mb = one.resident_mb() - before_mb
            if not number:
                before_mb = one.resident_mb()
                continue
            if not problem and left_mb > _MOST_LEFT_MB:
                problem = f'{left_mb:.0f} MB are left'
            yield Try(f'{number}: {width} x {height}, {channels}', problem)
            if one.process.poll() is not None:
                return


def _problem(one: Robot, sent: int) -> str:
    if not one.wait_for(
        lambda: unaccounted(one, sent) <= 0 and not one.count('queue'), _PATIENCE_S
    ):
        return f'{unaccounted(one, sent)} of {sent} images are unaccounted for'
    return f'took {one.most_mb():.0f} MB' if one.most_mb() > _MOST_MB else ''
