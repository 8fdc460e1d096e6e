# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the errors of matches where map and query have different frame spacings.

Usage: python scripts/spacing.py [--streets 901 902 908 910 911 912 913 914], about ten minutes.
Drawn streets are mapped by day and driven again in the evening in another lane (odd numbers), or
at night. 911 to 914 were used once, after all constants were fixed. A match is off if it is
further away than the larger of both spacings.
"""

from collections.abc import Sequence
from dataclasses import replace

from convseq_ros import build_map, Frame, PlaceRecognizer
from convseq_ros.simulation.street import Street
from drives import head, options, PASSED_OVER, row, Shots, shots
import numpy as np

STREETS = [901, 902, 908, 910, 911, 912, 913, 914]
SEEDS = {901: (1802, 1803), 902: (1804, 1805)}  # others: 2000 and 3000 more
EVENING = {'light': 'evening', 'lane_offset_m': -0.5, 'noise': 5}
NIGHT = {'light': 'night', 'noise': 10}
STEP_M = 0.5
SPACINGS_M = ((6, 0.5), (6, 1), (3, 0.5), (1, 1), (0.5, 3), (1, 6))  # map, query


def apart(drawn: Shots, spacing_m: float, first: int = 0) -> list[tuple[float, Frame]]:
    """Return the frames at a spacing, 0.1 s apart."""
    chosen: Sequence[tuple[float, Frame]] = drawn[first :: round(spacing_m / STEP_M)]
    return [
        (at, replace(frame, stamp_ns=(index + 1) * 100_000_000, pose=None, camera=None))
        for index, (at, frame) in enumerate(chosen)
    ]


def main() -> None:
    """Measure and print."""
    head('street', 'map m', 'query m', 'keyframes', 'accepted', 'off', 'median m', 'most m')
    for number in options(__doc__, streets=STREETS).streets:
        street, seeds = Street(400.0, number), SEEDS.get(number, (number + 2000, number + 3000))
        again = EVENING if number % 2 else NIGHT
        first, second = (
            shots(street, frame_rate_hz=20, num_frames=600, seed=seed, **how)
            for seed, how in zip(seeds, ({}, again), strict=True)
        )
        for spacing_m, query_m in SPACINGS_M:
            mapped = apart(first, spacing_m)
            where = {frame.stamp_ns: at for at, frame in mapped}
            recognizer = PlaceRecognizer(build_map([frame for _, frame in mapped]))
            off, keyframes = [], 0
            for at, frame in apart(second, query_m, round(query_m / STEP_M) // 2):
                match = recognizer.process(frame)
                keyframes += match.reason not in PASSED_OVER
                if match.accepted:
                    off.append(abs(where[match.accepted.reference_stamp_ns] - at))
            far = sum(error_m > max(spacing_m, query_m) for error_m in off)
            median, most = (float(np.median(off)), max(off)) if off else (np.nan, np.nan)
            errors = f'{median:.2f}', f'{most:.1f}'
            row(number, spacing_m, query_m, keyframes, len(off), far, *errors)


if __name__ == '__main__':
    main()
