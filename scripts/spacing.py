# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how far off matches are where map and query lie apart by other distances.

Usage: python scripts/spacing.py, some ten minutes. Drawn streets, mapped by day and driven again
in the evening, in another lane, or at night. On 901, 902, 908 and 910 it was found out what to do;
911 to 914 were looked at once, when all constants stood. A match is off if it is further away than
the larger of both spacings.
"""

from convseq_ros import build_map, Frame, PlaceRecognizer
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
import numpy as np

STEP_M = 0.5
EVENING = {'light': 'evening', 'lane_offset_m': -0.5, 'noise': 5}
NIGHT = {'light': 'night', 'noise': 10}
DRIVES = {  # street: map, query
    901: (Drive(seed=1802), Drive(seed=1803, **EVENING)),
    902: (Drive(seed=1804), Drive(seed=1805, **NIGHT)),
    908: (Drive(seed=2908), Drive(seed=3908, **NIGHT)),
    910: (Drive(seed=2910), Drive(seed=3910, **NIGHT)),
    911: (Drive(seed=2911), Drive(seed=3911, **EVENING)),
    912: (Drive(seed=2912), Drive(seed=3912, **NIGHT)),
    913: (Drive(seed=2913), Drive(seed=3913, **EVENING)),
    914: (Drive(seed=2914), Drive(seed=3914, **NIGHT)),
}
SPACINGS_M = ((6, 0.5), (6, 1), (3, 0.5), (1, 1), (0.5, 3), (1, 6))  # map, query
Shots = list[tuple[float, np.ndarray]]


def drawn(street: int, drive: Drive) -> Shots:
    """Return how far along each frame is, in metres, and the frame."""
    how = {name: getattr(drive, name) for name in ('seed', 'light', 'lane_offset_m', 'noise')}
    whole = Drive(frame_rate_hz=20, num_frames=600, width_px=320, height_px=240, **how)
    return [(shot.distance_m, shot.frame.gray) for shot in draw(Street(400.0, street), whole)]


def frames(shots: Shots) -> list[Frame]:
    """Return frames a tenth of a second apart."""
    return [Frame((index + 1) * 100_000_000, gray) for index, (_, gray) in enumerate(shots)]


def main() -> None:
    """Measure and print."""
    print('street  map m  query m  keyframes  accepted  off  median m  most m')
    for street, drives in DRIVES.items():
        first, second = (drawn(street, drive) for drive in drives)
        for spacing_m, query_m in SPACINGS_M:
            mapped = first[:: round(spacing_m / STEP_M)]
            asked = second[round(query_m / STEP_M) // 2 :: round(query_m / STEP_M)]
            reference_map = build_map(frames(mapped))
            where = {
                frame.stamp_ns: at for frame, (at, _) in zip(frames(mapped), mapped, strict=True)
            }
            here = [where[place.stamp_ns] for place in reference_map.places]
            recognizer = PlaceRecognizer(reference_map)
            off, keyframes = [], 0
            for frame, (at, _) in zip(frames(asked), asked, strict=True):
                match = recognizer.process(frame)
                keyframes += match.reason != 'between_keyframes'
                if match.accepted:
                    off.append(abs(here[match.accepted.reference_index] - at))
            far = sum(one > max(spacing_m, query_m) for one in off)
            median, most = (float(np.median(off)), max(off)) if off else (np.nan, np.nan)
            print(
                f'{street}  {spacing_m:7g}{query_m:9g}{keyframes:11}{len(off):10}{far:5}'
                f'{median:10.2f}{most:8.1f}',
                flush=True,
            )


if __name__ == '__main__':
    main()
