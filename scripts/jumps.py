# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what becomes of a drive that is carried elsewhere again and again, without being told.

Usage: python scripts/jumps.py --data FOLDER, a minute. FOLDER is that of laps.py. The map is the
first lap; the rest of the drive is cut into pieces of 30 images, which are shown in a drawn order,
a tenth of a second apart. A jump counts if the place is known before and after it, more than 100
places away. *Old* is a match after it that is still within 100 places of where the drive would
have gone on. Only keyframes are counted.
"""

import math
from pathlib import Path

from convseq_ros import build_map, PlaceRecognizer
from drives import head, options, PASSED_OVER, row
from known_drives import circuit, FIRST_LAP, lap_drive, pieces_of, until
import numpy as np


def main() -> None:
    """Map the first lap, jump through the rest, and print a table."""
    shown = circuit(options(__doc__, data=Path).data)
    first_lap = until(shown, FIRST_LAP)
    drive = lap_drive('jumps', shown[:first_lap], shown[first_lap:])
    where = {frame.stamp_ns: np.array(at) for frame, at in drive.mapped}
    made = build_map([frame for frame, _ in drive.mapped], None, drive.config)
    recognizer = PlaceRecognizer(made, drive.config)
    before, old, found = math.nan, list[int](), list[int]()
    for piece in pieces_of(drive.queries):
        frames, first, still = 0, None, 0
        for frame, here in piece:
            match = recognizer.process(frame)
            if match.reason in PASSED_OVER:
                continue
            frames += 1
            if match.accepted:
                at = where[match.accepted.reference_stamp_ns]
                off, old_off = drive.off(here, at), drive.off(before, at)
                if first is None and off <= drive.right:
                    first = frames
                still += bool(off > drive.wrong and old_off <= drive.wrong)
        if drive.off(before, np.array(piece[0][1])) > drive.wrong:
            old.append(still)
            found.append(first or frames + 1)
        before = piece[-1][1]
    head('jumps', 'old matches', 'jumps with one', 'first right, median', '95 %', 'within 3')
    quick = sum(frames <= 3 for frames in found)
    numbers = f'{np.median(found):.0f} | {np.percentile(found, 95):.0f} | {quick}'
    row(len(old), f'{sum(old)} | {sum(one > 0 for one in old)} | {numbers}')


if __name__ == '__main__':
    main()
