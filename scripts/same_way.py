# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how a map grows that a robot drives the same round with again and again.

Usage: python scripts/same_way.py [--rounds 34] [--max-looks 8] [--town 3] [--odometry], some five
minutes. Each round of a drawn block has other light, and is driven up to 1 m to the side of one
line, in online mode. Right is within 5 m of where the camera is; the first 15 keyframes of a round
do not count. `--odometry` does not drift.
"""

from pathlib import Path
import tempfile

from convseq_ros.config import make_config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.session import Session
from convseq_ros.core.types import Pose
from convseq_ros.simulation.route import Corner, Route
from drives import away_m, blind, head, lanes, options, PASSED_OVER, RIGHT_M, row, shots
import numpy as np

LIGHTS = ('day', 'evening', 'night', 'overcast')
BLOCK: tuple[Corner, ...] = (
    (10.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0), (0.0, 0.0), (10.0, 0.0),
)  # fmt: skip
STEP_M = 2.0
BEGINNING = 15  # keyframes
ROUND_NS = 10**11  # from one round's start to the next one's


def main() -> None:
    """Drive round and round, and print a row each time."""
    chosen = options(__doc__, rounds=34, max_looks=8, town=3, odometry=False)
    config = make_config({'mode': 'online', 'max_looks': chosen.max_looks, 'exclusion_s': 6.0})
    route, true = Route(BLOCK, chosen.town), dict[int, Pose | None]()  # by stamp
    head('round', 'light', 'right of keyframes', 'false', 'added', 'places', 'times the first')
    with tempfile.TemporaryDirectory() as folder:
        path, first = Path(folder, 'round.db'), 0
        for number in range(chosen.rounds):
            rng = np.random.default_rng(number)
            light = LIGHTS[number] if number < len(LIGHTS) else str(rng.choice(LIGHTS))
            drawn = shots(
                route, num_frames=int((route.length_m - 1) / STEP_M), speed_mps=10 * STEP_M,
                start_m=0.13 * (number % 10), start_ns=number * ROUND_NS, light=light, noise=3.0,
                lanes=lanes(route.length_m, -1.0, 1.0, rng), seed=number, width_px=160,
                height_px=120,
            )  # fmt: skip
            frames = [frame for _, frame in drawn]
            true.update((frame.stamp_ns, frame.pose) for frame in frames)
            session, found = Session(path, config), list[bool | None]()
            for frame in frames if chosen.odometry else blind(frames):
                match = session.recognizer.process(frame)
                session.save()
                if match.reason not in PASSED_OVER:
                    there = match.accepted and true[match.accepted.reference_stamp_ns]
                    off_m = away_m(there, true[frame.stamp_ns])
                    found.append(off_m <= RIGHT_M if there else None)
            session.close()
            places, later = len(open_map(path)), found[BEGINNING:]
            first = first or places
            right = f'{later.count(True)} of {len(later)}'
            told = found.count(False), session.added, places, f'{places / first:.1f}'
            row(number + 1, light, right, *told)


if __name__ == '__main__':
    main()
