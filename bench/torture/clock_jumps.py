# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps that jump, as clocks do that are set, and simulations that start again."""

from collections.abc import Iterator
from pathlib import Path
import random

from bench.torture import corpus
from bench.torture.attack import Try
from bench.torture.robot import image, robot

ABOUT = 'Stamps that go on, stand still, jump back or ahead, by up to the whole range of ROS'
ORACLE = 'every frame is answered; nothing fails'
COUNT, PORTION, SHORT, SEED = 1_000, 500, 0, 16
_FIRST_NS, _LAST_NS = -(2**31) * 10**9, 2**31 * 10**9 - 1
_JUMPS_NS = (10**8, 10**8, 10**8, 0, 1, -1, -(10**9) - 1, 10**9, 10**12, -(10**12), 10**18)
_IN_FLIGHT = 5
_PATIENCE_S = 60.0


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Send frames, a few at a time."""
    draw = random.Random(seed)
    if not count:
        return
    with robot(
        folder,
        mode='online',
        map_path=folder / 'map.db',
        max_wait_s=0.0,
        queue_size=100,
        image_size_px=256,
        diagnostics_period_s=0.2,
    ) as one:
        stamp_ns = 10**18
        for number in range(count):
            if draw.random() < 0.05:
                stamp_ns = draw.choice((_FIRST_NS, -1, 0, 1, _LAST_NS, draw.randrange(_LAST_NS)))
            stamp_ns = min(max(stamp_ns + draw.choice(_JUMPS_NS), _FIRST_NS), _LAST_NS)
            one.camera.publish(image(corpus.gray(number % 50), stamp_ns))
            answered = one.wait_for(
                lambda number=number: one.answers >= number + 1 - _IN_FLIGHT, _PATIENCE_S
            )
            ended = one.process.poll() is not None
            yield Try(
                f'{number}: {stamp_ns}',
                'the node ended' if ended else '' if answered else 'no answer',
            )
            if ended:
                return
        one.wait_for(lambda: one.answers >= count and one.count('processed') >= count, _PATIENCE_S)
        if one.answers < count or one.count('failed'):
            yield Try('all', f'{one.answers} of {count} answered, {one.count("failed")} failed')
