# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how often answers of each confidence range are right, accepted or not.

Usage: python scripts/reliability.py, a few minutes. The drives are CHECKS of drawn_drives.py,
which were never used for fitting, with two halves of the map and with the map of another street.
"""

from collections.abc import Iterator
from dataclasses import replace

from convseq_ros.app.map_builder import build_map
from convseq_ros.config import Config, make_config
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Reason
from convseq_ros.evaluation.metrics import EDGES, reliability
from convseq_ros.evaluation.protocols import kept_halves
from convseq_ros.evaluation.truth import Truth
from drawn_drives import CHECKS, drawn, Pair
import numpy as np

LEAST = 50  # frames of a bin, below which its gap does not count
Answers = Iterator[tuple[float, bool]]  # confidence, and whether right or a slip


def answers(
    frames: list[Frame], mapped: ReferenceMap, right: np.ndarray, config: Config
) -> Answers:
    """Yield confidence and correctness of each keyframe's answer."""
    recognizer = PlaceRecognizer(mapped, config)
    number = {place.stamp_ns: index for index, place in enumerate(mapped.places)}
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
        # `build_map` leaves frames out, so rows are assigned by stamps.
        mapped = build_map(references[first:last])
        index = {one.stamp_ns: place for place, one in enumerate(references)}
        kept = [index[place.stamp_ns] for place in mapped.places]
        yield from answers(frames, mapped, right[:, kept], config)
    elsewhere, _ = drawn(replace(pair, seed=pair.seed + 5000, is_terrace=False), False)
    mapped = build_map(elsewhere)
    yield from answers(frames, mapped, np.zeros((len(frames), len(mapped)), bool), config)


def show(name: str, answers: np.ndarray) -> None:
    """Print a table."""
    confidences, right = answers[:, 0], answers[:, 1] > 0
    rows = reliability(confidences, right)
    print(f'{name}, {len(answers)} answers')
    for row in rows:
        print('  {low:.2f} to {high:.2f}: {count} said {said:.3f} right {right:.3f}'.format(**row))
    gaps = [abs(row['said'] - row['right']) for row in rows if row['count'] >= LEAST]
    sure = right[confidences >= EDGES[-2]]
    print(f'  largest gap of a bin with {LEAST}: {max(gaps, default=0.0):.3f}', end='; ')
    print(f'{len(sure)} of at least {EDGES[-2]}, right {sure.mean():.4f}' if len(sure) else 'none')


def main() -> None:
    """Measure and print."""
    tables = {pair.name: np.array(list(of_drawn(pair)), float) for pair in CHECKS}
    for name, rows in (*tables.items(), ('all', np.concatenate([*tables.values()]))):
        show(name, rows)


if __name__ == '__main__':
    main()
