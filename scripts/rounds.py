# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the recall of a drive against its own past: three rounds of a town.

Usage: python scripts/rounds.py [--towns 1 2] [--threads 1], two minutes per town.
One drive goes round a drawn town three times, up to 0.6 m to the side of a line, in online mode
without odometry. A match is right within 5 m of the camera's position.
"""

from collections import Counter

from convseq_ros import build_map, Config, Frame, PlaceRecognizer
from convseq_ros.config import make_config
from convseq_ros.simulation.route import Corner, Route
from drives import away_m, blind, count, head, lanes, options, RIGHT_M, row, shots
import numpy as np

BLOCK: tuple[Corner, ...] = ((0.0, 0.0), (120.0, 0.0), (120.0, 80.0), (0.0, 80.0))
START: Corner = (10.0, 0.0)  # on the first street; also the end
ROUNDS = 3


def rounds(seed: int, config: Config) -> list[Counter[str]]:
    """Return the counts of a drive against its own past, round by round."""
    first, *corners = BLOCK
    route = Route((START, *corners, *BLOCK * (ROUNDS - 1), first, START), seed)
    line = lanes(route.length_m, -1.0, 0.6, np.random.default_rng(seed))
    drawn = shots(route, num_frames=int(route.length_m), lanes=line, noise=2.0, seed=seed)
    true = {frame.stamp_ns: frame.pose for _, frame in drawn}
    recognizer = PlaceRecognizer(build_map([], None, config), config)
    parts: list[list[Frame]] = [[] for _ in range(ROUNDS)]
    for at_m, frame in drawn:
        parts[min(int(ROUNDS * at_m / route.length_m), ROUNDS - 1)].append(frame)
    return [
        count(
            recognizer,
            blind(part),
            lambda frame, match: (
                away_m(true[match.reference_stamp_ns], true[frame.stamp_ns]) <= RIGHT_M
            ),
        )
        for part in parts
    ]


def main() -> None:
    """Draw, recognise, and print two tables."""
    chosen = options(__doc__, towns=[1, 2], threads=0)
    online = {'threads': chosen.threads, 'mode': 'online'}
    head('town', 'round', 'keyframes', 'right', 'recall', 'false')
    for seed in chosen.towns:
        for number, counts in enumerate(rounds(seed, make_config(online)), 1):
            keyframes, right = counts['keyframes'], counts['right']
            share = f'{right / keyframes:.3f}' if number > 1 else ''
            row(seed, number, keyframes, right, share, counts['false'])


if __name__ == '__main__':
    main()
