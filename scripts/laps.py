# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the recall on a circuit that is driven in laps, and on another circuit in the same hall.

Usage: python scripts/laps.py --data FOLDER [--only QUERY], about three minutes; with --only 'other
circuit', its row alone. FOLDER holds drive/, other/ and ground_truth.csv. Recall is the share of
known keyframes with a right match. A keyframe is known if its true place is in the matchable part
of the map. A match is right within 40 places of the true place and wrong beyond 100; a lap has 840
places. The places of frames 1232 to 1371 are unknown. All matches of other/ are wrong. The query
`all of the drive` includes the map's frames. Online, a place is known after 10 s; in the drive
whose laps last 9 s, once it may be matched.
"""

from dataclasses import dataclass, replace
import math
from pathlib import Path

from convseq_ros import build_map, Frame, PlaceRecognizer
from convseq_ros.core.types import Reason
from drives import head, options, PASSED_OVER, row
from known_drives import (
    circuit,
    config_of,
    Drive,
    FIRST_LAP,
    LAP,
    lap_drive,
    number,
    other_circuit,
    until,
)
import numpy as np

HALF = 2400  # the last frame of a map, by its name
LAST_LAP = 3556  # the last frame before it
KNOWN_AFTER_S, QUICK_LAP_S = 10.0, 9.0


@dataclass(slots=True)
class Counts:
    """Counts of a drive's keyframes."""

    known: int = 0
    right: int = 0
    wrong: int = 0
    accepted: int = 0

    def __str__(self) -> str:
        ratio = f'{self.right} of {self.known}' if self.known else ''
        share = f'{self.right / self.known:.3f}' if self.known else ''
        return f'{ratio} | {share} | {self.wrong} | {self.accepted}'


def quick(frame: Frame) -> Frame:
    """Return a frame of the same drive, with laps of 9 s."""
    return replace(frame, stamp_ns=round(number(frame) / LAP * QUICK_LAP_S * 1e9))


def count(drive: Drive, known_after_s: float | None) -> Counts:
    """Recognise; online, places are known after a time, or, without one, once they may match."""
    made = build_map([frame for frame, _ in drive.mapped], None, drive.config)
    recognizer, online = PlaceRecognizer(made, drive.config), drive.config.online.grows
    where = {frame.stamp_ns: at for frame, at in drive.mapped or drive.queries}
    counts = Counts()
    for frame, here in drive.queries:
        match = recognizer.process(frame)
        if match.reason in (*PASSED_OVER, Reason.UNREADABLE) or (
            online and number(frame) <= FIRST_LAP
        ):
            continue
        places = made.places[: recognizer.mapping.usable]
        if online and known_after_s is not None:
            until_ns = frame.stamp_ns - round(known_after_s * 1e9)
            places = [one for one in made.places if one.stamp_ns <= until_ns]
        off = drive.off(here, np.array([where[one.stamp_ns] for one in places]))
        known = bool((off <= drive.right).any())
        counts.known += known
        if accepted := match.accepted:
            off = drive.off(here, np.array(where[accepted.reference_stamp_ns]))
            counts.accepted += 1
            counts.right += known and bool(off <= drive.right)
            counts.wrong += math.isinf(here) or bool(off > drive.wrong)
    return counts


def main() -> None:
    """Map, recognise, and print a table."""
    chosen = options(__doc__, data=Path, only='')
    drive, other, online = (
        circuit(chosen.data),
        other_circuit(chosen.data),
        config_of(mode='online'),
    )
    first, half, last = (until(drive, one) for one in (FIRST_LAP, HALF, LAST_LAP))
    rapid = [(quick(frame), at) for frame, at in drive]
    head('map', 'query', 'right of known', 'recall', 'wrong', 'accepted')
    for name, query, what, known_after_s in (
        ('first lap', 'all of the drive', (drive[:first], drive), KNOWN_AFTER_S),
        ('first lap', 'what follows', (drive[:first], drive[first:]), KNOWN_AFTER_S),
        (
            'first lap', f'other circuit, {len(other)} frames', (drive[:first], other),
            KNOWN_AFTER_S,
        ),
        ('online', 'from the second lap on', ([], drive, online), KNOWN_AFTER_S),
        (f'up to {HALF}', 'what follows', (drive[:half], drive[half:]), KNOWN_AFTER_S),
        ('laps of 9 s, all but the last', 'the last', (rapid[:last], rapid[last:]), KNOWN_AFTER_S),
        ('laps of 9 s, online', 'from the second lap on', ([], rapid, online), None),
    ):  # fmt: skip
        if chosen.only in query:
            row(name, query, count(lap_drive(name, *what), known_after_s))


if __name__ == '__main__':
    main()
