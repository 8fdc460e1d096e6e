# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how often answers of each confidence are right, accepted or refused.

Usage: python scripts/reliability.py [--data FOLDER], some minutes. Nothing was fitted on these:
CHECKS of drawn_drives.py, asked with two halves of the map and in another street; with `--data`,
the folder of the data sets, Gardens Point with three halves, as it is and with .8 of the light
taken.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from convseq_ros.config import EVERY_FRAME, make_config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.view import upright
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Descriptor, Frame, Reason
from convseq_ros.evaluation.data_set import open_data_set
from convseq_ros.evaluation.material import open_material
from convseq_ros.evaluation.metrics import EDGES, reliability
from convseq_ros.evaluation.protocols import kept_halves
from convseq_ros.evaluation.recognition import part_of
from convseq_ros.evaluation.truth import Truth
import cv2
from drawn_drives import CHECKS, drawn, Pair
from drives import options
import numpy as np

REAL = 'gardens_point_day_day'
LAMPS, NOISE = 6, 12.0  # of an image whose light is taken; noise in grey levels
LEAST = 50  # frames of a bin whose gap counts
Answers = Iterator[tuple[float, bool]]  # confidence; right, or a slip
Asked = list[tuple[Frame, Descriptor | None]]


def answers(asked: Asked, made: ReferenceMap, right: np.ndarray, config) -> Answers:
    """Yield what is known of each keyframe's answer."""
    recognizer = PlaceRecognizer(made, config)
    number = {place.stamp_ns: index for index, place in enumerate(made.places)}
    for index, (frame, descriptor) in enumerate(asked):
        match = recognizer.process(frame, descriptor)
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
    asked, config = [(frame, None) for frame in frames], make_config({})
    halves = kept_halves(len(references))
    for first, last in (halves['first'], halves['middle']):
        # What `build_map` leaves out is not counted, so rows go by stamps.
        made = build_map(references[first:last])
        index = {one.stamp_ns: place for place, one in enumerate(references)}
        kept = [index[place.stamp_ns] for place in made.places]
        yield from answers(asked, made, right[:, kept], config)
    elsewhere, _ = drawn(replace(pair, seed=pair.seed + 5000, kind='street'), False)
    made = build_map(elsewhere)
    yield from answers(asked, made, np.zeros((len(frames), len(made)), bool), config)


def darker(gray: np.ndarray, share: float, generator: np.random.Generator) -> np.ndarray:
    """Return an image, uint8 (H, W), without so much of its light, with noise and lamps."""
    if not share:
        return gray
    height, width = gray.shape
    light = np.zeros((height, width), np.float32)
    for _ in range(LAMPS):
        x, y = generator.integers(0, width), generator.integers(0, max(1, height // 2))
        cv2.circle(light, (int(x), int(y)), max(1, width // 60), 255.0, -1)
    glow = cv2.GaussianBlur(light, (0, 0), max(1.0, width / 40)) + light
    noise = generator.normal(0, NOISE * share, gray.shape)
    dark = gray * (1 - share) + share * glow + noise
    return np.clip(np.rint(dark), 0, 255).astype(np.uint8)


def of_real(name: str, data: Path, darkened: float) -> Answers:
    """Yield the answers to a real drive, so much of its light taken."""
    config = make_config(EVERY_FRAME.spacing)
    material = open_material(open_data_set(name, data), config.encoding)
    _, references = material.drives(config.encoding)
    asked: Asked = []
    for index, frame in enumerate(material.query):
        gray = darker(frame.gray, darkened, np.random.default_rng([index, 6]))
        seen = upright(replace(frame, gray=gray), config.encoding)
        asked.append((Frame(frame.stamp_ns, None), describe(seen.gray, config.encoding)))
    right = material.truth.right | material.truth.slip
    for first, last in kept_halves(len(references)).values():
        part = part_of(references.reference_map, first, last)
        yield from answers(asked, part, right[:, first:last], config)


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
    data = options(__doc__, data=None).data
    tables = {pair.name: np.array(list(of_drawn(pair)), float) for pair in CHECKS}
    for darkened in (0.0, 0.8) if data else ():
        answered = list(of_real(REAL, data, darkened))
        tables[f'{REAL} {darkened}'] = np.array(answered, float)
    for name, rows in (*tables.items(), ('all', np.concatenate([*tables.values()]))):
        show(name, rows)


if __name__ == '__main__':
    main()
