# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how a map grows that a robot drives the same round with again and again.

Usage: python scripts/same_way.py [--rounds 34] [--max-looks 8] [--town 3] [--odometry], some five
minutes. Each round of a drawn block has other light, and is driven up to 1 m to the side of one
line, in online mode. Right is within 5 m of where the camera is; the first 15 keyframes of a round
do not count.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
import math
from pathlib import Path
import sys
import tempfile

from convseq_ros import Frame
from convseq_ros.config import make_config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.session import Session
from convseq_ros.core.types import Pose, Reason
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.route import Corner, Route
import numpy as np

LIGHTS = ('day', 'evening', 'night', 'overcast')
BLOCK: tuple[Corner, ...] = (
    (10.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0), (0.0, 0.0), (10.0, 0.0),
)  # fmt: skip
STEP_M, ASIDE_M, LANES_EVERY_M = 2.0, 1.0, 30.0
RIGHT_M = 5.0
BEGINNING = 15  # keyframes
ROUND_NS = 10**11  # from one round's start to the next one's


def driven(town: int, number: int) -> tuple[str, Iterator[tuple[Frame, Pose]]]:
    """Return the light of a round by its number, its frames, and where they were taken."""
    route, rng = Route(BLOCK, town), np.random.default_rng(number)
    light = LIGHTS[number] if number < len(LIGHTS) else str(rng.choice(LIGHTS))
    at = np.arange(0.0, route.length_m + LANES_EVERY_M, LANES_EVERY_M)
    lanes = rng.uniform(-ASIDE_M, ASIDE_M, len(at)) - 1.0
    drive = Drive(
        num_frames=int((route.length_m - 1) / STEP_M),
        speed_mps=10 * STEP_M,
        start_m=0.13 * (number % 10),
        start_ns=number * ROUND_NS,
        lanes=tuple(zip(at.tolist(), lanes.tolist(), strict=True)),
        light=light,
        noise=3.0,
        seed=number,
        width_px=160,
        height_px=120,
    )
    return light, ((shot.frame, shot.pose) for shot in draw(route, drive))


def main() -> int:
    """Drive round and round, and print a row each time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rounds', type=int, default=34)
    parser.add_argument('--max-looks', type=int, default=8)
    parser.add_argument('--town', type=int, default=3)
    parser.add_argument('--odometry', action='store_true', help='that does not drift')
    chosen = parser.parse_args()
    config = make_config({'mode': 'online', 'max_looks': chosen.max_looks, 'exclusion_s': 6.0})
    true = dict[int, Pose]()  # by stamp
    print('| round | light | right of keyframes | false | added | places | times the first |')
    print('|---|---|---|---|---|---|---|')
    with tempfile.TemporaryDirectory() as folder:
        path, first = Path(folder, 'round.db'), 0
        for number in range(chosen.rounds):
            light, shots = driven(chosen.town, number)
            session, found = Session(path, config), list[bool | None]()
            for frame, pose in shots:
                true[frame.stamp_ns] = pose
                asked = frame if chosen.odometry else replace(frame, pose=None)
                match = session.recognizer.process(asked)
                session.save()
                if match.reason in (Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY):
                    continue
                there = match.accepted and true[match.accepted.reference_stamp_ns].position
                found.append(math.dist(there, pose.position) <= RIGHT_M if there else None)
            session.close()
            places, later = len(open_map(path)), found[BEGINNING:]
            first = first or places
            right = f'{later.count(True)} of {len(later)}'
            row = number + 1, light, right, found.count(False), session.added, places
            print('| ' + ' | '.join(map(str, row)) + f' | {places / first:.1f} |', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
