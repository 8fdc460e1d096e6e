# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the recall of a drive against its own past: three rounds of a town.

Usage: python scripts/rounds.py [--towns 1 2], two minutes per town. One drive goes round a drawn
town three times, up to 0.6 m to the side of a line, in online mode without odometry. A match is
right within 5 m of the camera's position.
"""

from collections import Counter
from dataclasses import replace

from convseq_ros import build_map, PlaceRecognizer
from convseq_ros.simulation.route import Corner, Route
from drives import away_m, head, lanes, options, PASSED_OVER, RIGHT_M, row, shots
from known_drives import config_of
import numpy as np

BLOCK: tuple[Corner, ...] = ((0.0, 0.0), (120.0, 0.0), (120.0, 80.0), (0.0, 80.0))
START: Corner = (10.0, 0.0)  # on the first street; also the end
ROUNDS = 3


def rounds(seed: int) -> list[Counter[str]]:
    """Return the counts of a drive against its own past, round by round."""
    first, *corners = BLOCK
    route = Route((START, *corners, *BLOCK * (ROUNDS - 1), first, START), seed)
    line = lanes(route.length_m, -1.0, 0.6, np.random.default_rng(seed))
    drawn = shots(route, num_frames=int(route.length_m), lanes=line, noise=2.0, seed=seed)
    true = {frame.stamp_ns: frame.pose for _, frame in drawn}
    config = config_of(mode='online')
    recognizer = PlaceRecognizer(build_map([], None, config), config)
    found = [Counter[str]() for _ in range(ROUNDS)]
    for at_m, frame in drawn:
        counts = found[min(int(ROUNDS * at_m / route.length_m), ROUNDS - 1)]
        match = recognizer.process(replace(frame, pose=None))
        counts['keyframes'] += match.reason not in PASSED_OVER
        if match.accepted:
            off_m = away_m(true[match.accepted.reference_stamp_ns], frame.pose)
            counts['right' if off_m <= RIGHT_M else 'false'] += 1
    return found


def main() -> None:
    """Draw, recognise, and print a table."""
    chosen = options(__doc__, towns=[1, 2])
    head('town', 'round', 'keyframes', 'right', 'recall', 'false')
    for seed in chosen.towns:
        for number, counts in enumerate(rounds(seed), 1):
            keyframes, right = counts['keyframes'], counts['right']
            share = f'{right / keyframes:.3f}' if number > 1 else ''
            row(seed, number, keyframes, right, share, counts['false'])


if __name__ == '__main__':
    main()
