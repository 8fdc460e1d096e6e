# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what becomes of a drive that is carried elsewhere again and again, without being told.

Usage: python scripts/jumps.py --data FOLDER [--piece 30] [--threads 1], a minute. FOLDER is that
of laps.py. The map is the first lap; the rest of the drive is cut into pieces of some images,
which are shown in a drawn order, a tenth of a second apart. A jump counts if the place is known
before and after it, more than 100 places away. *Old* is a match after it that is still within 100
places of where the drive would have gone on. Only keyframes are counted.
"""

from dataclasses import replace
from pathlib import Path

from convseq_ros import build_map, PlaceRecognizer
from convseq_ros.config import make_config
from convseq_ros.sources.folder import ImageFolder
from drives import head, options, PASSED_OVER, row
from laps import FIRST_LAP, number, off, place, read_truth, RIGHT, WRONG
import numpy as np

FIRST = 10**15  # stamp of the first image, in ns
STEP = 10**8  # between images, in ns


def main() -> None:
    """Map the first lap, jump through the rest, and print a table."""
    chosen = options(__doc__, data=Path, piece=30, threads=0)
    config = make_config({'threads': chosen.threads})
    drive = list(ImageFolder(chosen.data / 'drive'))
    truth = read_truth(chosen.data / 'ground_truth.csv')
    mapped = [frame for frame in drive if number(frame) <= FIRST_LAP]
    rest = drive[len(mapped) :]
    pieces = [rest[at : at + chosen.piece] for at in range(0, len(rest), chosen.piece)]
    np.random.default_rng(0).shuffle(pieces)
    where = {frame.stamp_ns: place(truth, number(frame)) for frame in mapped}
    recognizer = PlaceRecognizer(build_map(mapped, None, config), config)
    shown, before, old, found = 0, None, list[int](), list[int]()
    for piece in pieces:
        here = place(truth, number(piece[0]))
        counts = before is not None and here is not None and off(here, before) > WRONG
        frames, first, still = 0, None, 0
        for frame in piece:
            match = recognizer.process(replace(frame, stamp_ns=FIRST + shown * STEP))
            shown, there = shown + 1, place(truth, number(frame))
            if match.reason in PASSED_OVER:
                continue
            frames += 1
            at = match.accepted and where[match.accepted.reference_stamp_ns]
            if at is None or there is None:
                continue
            if first is None and off(at, there) <= RIGHT:
                first = frames
            gone_on = before if before is not None else there
            still += off(at, there) > WRONG and off(at, gone_on) <= WRONG
        if counts:
            old.append(still)
            found.append(first or frames + 1)
        before = there
    head('jumps', 'old matches', 'jumps with one', 'first right, median', '95 %', 'within 3')
    quick = sum(frames <= 3 for frames in found)
    numbers = f'{np.median(found):.0f} | {np.percentile(found, 95):.0f} | {quick}'
    row(len(old), f'{sum(old)} | {sum(one > 0 for one in old)} | {numbers}')


if __name__ == '__main__':
    main()
