# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how often answers of each confidence are right, accepted or refused.

Usage: python scripts/reliability.py, some minutes. Nothing was fitted on these: CHECKS of
drawn_drives.py, asked with two halves of the map and in another street.
"""

from collections.abc import Iterator
from dataclasses import replace

from convseq_ros.config import make_config
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Reason
from convseq_ros.evaluation.metrics import EDGES, reliability
from convseq_ros.evaluation.protocols import kept_halves
from convseq_ros.evaluation.truth import Truth
from drawn_drives import CHECKS, drawn, Pair
import numpy as np

LEAST = 50  # frames of a bin whose gap counts
Answers = Iterator[tuple[float, bool]]  # confidence; right, or a slip


def answers(frames: list[Frame], made: ReferenceMap, right: np.ndarray, config) -> Answers:
    """Yield what is known of each keyframe's answer."""
    recognizer = PlaceRecognizer(made, config)
    number = {place.stamp_ns: index for index, place in enumerate(made.places)}
    for index, frame in enumerate(frames):
        match = recognizer.process(frame)
        if match.reason in (Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY) or not match.best:
            continue
        if match.confidence is not None:
            where = number[match.best.reference_stamp_ns]
            yield match.confidence, right[index, where]


def of_drawn(pair: Pair) -> Answers:
    """Yield the answers to a drawn drive."""
    frames, there = drawn(pair, True)
    references, here = drawn(pair, False)
    away = abs(there[:, None] - here)
    near = abs(away.argmin(axis=1)[:, None] - np.arange(len(here))) <= 2
    right = near & (away.min(axis=1) <= 0.75 * pair.step_m)[:, None]
    right |= Truth(right).slip
    config, halves = make_config({}), kept_halves(len(references))
    for first, last in (halves['first'], halves['middle']):
        # What `build_map` leaves out is not counted, so rows go by stamps.
        made = build_map(references[first:last])
        index = {one.stamp_ns: place for place, one in enumerate(references)}
        kept = [index[place.stamp_ns] for place in made.places]
        yield from answers(frames, made, right[:, kept], config)
    elsewhere, _ = drawn(replace(pair, seed=pair.seed + 5000, is_terrace=False), False)
    made = build_map(elsewhere)
    yield from answers(frames, made, np.zeros((len(frames), len(made)), bool), config)


def show(name: str, found: np.ndarray) -> None:
    """Print a table."""
    said, right = found[:, 0], found[:, 1] > 0
    rows = reliability(said, right)
    print(f'{name}, {len(found)} answers')
    for row in rows:
        print('  {low:.2f} to {high:.2f}: {count} said {said:.3f} right {right:.3f}'.format(**row))
    gaps = [abs(row['said'] - row['right']) for row in rows if row['count'] >= LEAST]
    sure = right[said >= EDGES[-2]]
    print(f'  largest gap of a bin with {LEAST}: {max(gaps, default=0.0):.3f}', end='; ')
    print(f'of {len(sure)} that say {EDGES[-2]}, right {sure.mean():.4f}' if len(sure) else 'none')


def main() -> None:
    """Measure and print."""
    tables = {pair.name: np.array(list(of_drawn(pair)), float) for pair in CHECKS}
    for name, rows in (*tables.items(), ('all', np.concatenate([*tables.values()]))):
        show(name, rows)


if __name__ == '__main__':
    main()
