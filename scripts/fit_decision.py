# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Replay drives with other constants of the decision, and print what becomes of them.

Usage: python scripts/fit_decision.py [--data FOLDER] [--change NAME=VALUE,... ...]
[--fit NAME ...] [--processes 2]. On two cores it takes some minutes to encode the drives, and one
for each change. A name is RECORD.name, such as BELIEF.entering. Each change is tried by itself. A
constant to fit is multiplied and divided by 1.5, again and again, as long as the score grows.

The score is the mean of log(p + 0.001) over a drive's keyframes, where p is the probability that
the belief gives to the truth: the places within the right distance, or *elsewhere*. It is summed
over drives; 0 is perfect. A match is right within the right distance, and false beyond the wrong
one; between them it counts as neither.
"""

from collections import Counter
from concurrent.futures import ProcessPoolExecutor
import math
from pathlib import Path
import sys
from typing import Any, NamedTuple

from convseq_ros import build_map, PlaceRecognizer
from convseq_ros.core.decision import (
    belief,
    belief_decider,
    comparison,
    likelihood,
    motion,
    observation,
    usual_lead,
)
from convseq_ros.core.decision.decider import Answer
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor, Frame
from drives import head, options, progress, row
from known_drives import Drive, Make, more, real, streets
import numpy as np

RECORDS = {
    'CELLS': likelihood.CELLS, 'COPIES': likelihood.COPIES, 'KEYPOINTS': usual_lead.KEYPOINTS,
    'COMPARED': comparison.COMPARED, 'ASKED': observation.ASKED, 'BELIEF': belief.BELIEF,
    'MOTION': motion.MOTION,
}  # fmt: skip
FLOOR = 0.001  # of a probability: an answer cannot be more wrong than this
FACTOR = 1.5
Changes = dict[str, Any]


class Encoded(NamedTuple):
    """A drive whose keyframes are encoded."""

    drive: Drive
    made: ReferenceMap
    keyframes: list[tuple[Frame, Descriptor]]


PREPARED: list[Encoded] = []  # of this process


def encoded(drive: Drive) -> Encoded:
    """Return a drive with its keyframes, which do not depend on the decision."""
    progress(f'encoding {drive.name}')
    made = build_map([frame for frame, _ in drive.mapped], None, drive.config)
    recognizer, keyframes = PlaceRecognizer(made, drive.config), list[tuple[Frame, Descriptor]]()
    decide = recognizer._decide

    def keep(frame: Frame, usable: int, missing: int) -> Answer:
        keyframes.append((frame, recognizer._buffer.newest.descriptor))
        return decide(frame, usable, missing)

    recognizer._decide = keep
    for frame, _ in drive.queries:
        recognizer.process(frame)
    return Encoded(drive, made, keyframes)


def prepare(makers: list[Make]) -> None:
    """Encode the drives of this process."""
    PREPARED.extend(encoded(make()) for make in makers)


def replay(
    drive: Drive, made: ReferenceMap, keyframes: list[tuple[Frame, Descriptor]]
) -> Counter[str]:
    """Return the score of a drive, and its right and false matches."""
    if drive.config.online.grows:  # the map has grown, so begin with an empty one
        made = build_map([], None, drive.config)
    recognizer, counts = PlaceRecognizer(made, drive.config), Counter[str]()
    queries = {frame.stamp_ns: here for frame, here in drive.queries}
    mapped = {frame.stamp_ns: here for frame, here in drive.mapped} or queries
    logs = []
    for frame, descriptor in keyframes:
        match, here = recognizer.process(frame, descriptor), queries[frame.stamp_ns]
        places = made.places[: recognizer.mapping.usable]
        off = drive.off(here, np.array([mapped[one.stamp_ns] for one in places]))
        if (found := probability(recognizer, off, drive)) is not None:
            logs.append(math.log(found + FLOOR))
        if match.accepted:
            away = off[match.accepted.reference_index]
            counts['right'] += bool(away <= drive.right)
            counts['false'] += bool(away > drive.wrong)
    counts['score'] = float(np.mean(logs)) if logs else 0.0  # type: ignore[assignment]
    return counts


def probability(recognizer: PlaceRecognizer, off: np.ndarray, drive: Drive) -> float | None:
    """Return the probability of the truth; None if it is unknown. `off` (n,) are distances."""
    believed, known = recognizer.decider._belief, off[~np.isnan(off)]
    if len(off) and not len(known):
        return None
    if len(known) and known.min() <= drive.right:
        return float(believed.mass[off[believed.places] <= drive.right].sum())
    is_elsewhere = not len(known) or known.min() > drive.wrong
    return believed.elsewhere if is_elsewhere else None


def results(changes: Changes) -> dict[str, Counter[str]]:
    """Return the counts of the drives of this process, with changed constants."""
    before = {name: of(name) for name in changes}
    try:
        for name, value in changes.items():
            set_to(name, value)
        return {one.drive.name: replay(*one) for one in PREPARED}
    finally:
        for name, value in before.items():
            set_to(name, value)


def of(name: str) -> Any:
    """Return the value of a constant."""
    record, _, field = name.partition('.')
    return getattr(RECORDS[record], field)


def set_to(name: str, value: Any) -> None:
    """Change a constant of this process."""
    record, _, field = name.partition('.')
    object.__setattr__(RECORDS[record], field, value)
    # What modules compute from constants when they are imported.
    least = 1 - likelihood.CELLS.works
    likelihood.UNVERIFIED = observation.UNVERIFIED = math.log(least)
    belief_decider._DENIED = least / 2


class Drives:
    """Drives that are shared by processes."""

    def __init__(self, makers: list[Make], processes: int) -> None:
        self._pools = [
            ProcessPoolExecutor(1, initializer=prepare, initargs=(makers[number::processes],))
            for number in range(processes)
        ]

    def score(self, changes: Changes) -> float:
        """Replay all drives, print a row, and return the score."""
        waiting = [pool.submit(results, changes) for pool in self._pools]
        found = {name: counts for one in waiting for name, counts in one.result().items()}
        total = sum(counts['score'] for counts in found.values())
        right, false = (sum(one[kind] for one in found.values()) for kind in ('right', 'false'))
        each = (f'{name} {one["right"]}+{one["false"]}' for name, one in sorted(found.items()))
        changed = ' '.join(f'{name}={value:.4g}' for name, value in changes.items())
        row(changed or 'shipped', f'{total:.3f}', right, false, '; '.join(each))
        return total


def fitted(drives: Drives, name: str, changes: Changes, best: float) -> tuple[Changes, float]:
    """Return the changes with a constant as good as it gets, and their score."""
    for factor in (FACTOR, 1 / FACTOR):
        first = best
        while True:
            tried = {**changes, name: changes.get(name, of(name)) * factor}
            if (score := drives.score(tried)) <= best:
                break
            changes, best = tried, score
        if best > first:
            break
    return changes, best


def main() -> None:
    """Encode, replay, and print a table."""
    chosen = options(__doc__, data=None, change=[''], fit=[''], processes=2)
    data: Path | None = chosen.data
    makers = [*(real(data, {}) if data else ()), *more(data, {}), *streets({})]
    drives, changes = Drives(makers, chosen.processes), Changes()
    head('changed', 'score', 'right', 'false', 'right + false of each drive')
    best = drives.score(changes)
    for words in filter(None, chosen.change):
        pairs = (word.split('=') for word in words.split(','))
        drives.score({name: float(value) for name, value in pairs})
    for name in filter(None, chosen.fit):
        changes, best = fitted(drives, name, changes, best)
    for name, value in changes.items():
        print(f'{name} = {value:.4g}', file=sys.stderr)


if __name__ == '__main__':
    main()
