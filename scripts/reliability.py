# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how often answers of each confidence are right, accepted or refused.

Usage: python scripts/reliability.py [--fit] DATA [NAME...], DATA the folder of the data sets; some
minutes. Drawn drives of acceptance_drives.py are asked with two halves of the map and in another
street; Gardens Point and corridor with three halves, by day and with .8 of the light taken. With
`--fit` other drives, and .9 taken, and the constants that fit these best.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
import sys
import tempfile

from acceptance_drives import CHECKS, drawn, judgements, Pair, PAIRS
from convseq_ros.config import EVERY_FRAME, make_config
from convseq_ros.core.decision.confidence import CONFIDENCE, confidence
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Descriptor, Frame, Reason
from convseq_ros.evaluation.cache import Cache
from convseq_ros.evaluation.calibration import logistic_weights, reliability
from convseq_ros.evaluation.changes import picture_change
from convseq_ros.evaluation.data_set import open_data_set
from convseq_ros.evaluation.material import open_material
from convseq_ros.evaluation.protocols import kept_halves
from convseq_ros.evaluation.rerun import part_of
from convseq_ros.evaluation.truth import Truth
import numpy as np

FITTED = (
    'heading-night', 'low-heading', 'night-noise-3', 'rain-blur', 'traffic', 'terrace',
    'terrace-night',
)  # fmt: skip
REAL = ('gardens_point_day_day', 'corridor')
Answers = Iterator[tuple[float, float, float, bool]]  # evidence, share, balance; right, or a slip
Asked = list[tuple[Frame, Descriptor | None]]


def answers(asked: Asked, made: ReferenceMap, right: np.ndarray, config) -> Answers:
    """Yield what is known of each keyframe's answer."""
    recognizer = PlaceRecognizer(made, config)
    judged = judgements(recognizer)
    number = {place.stamp_ns: index for index, place in enumerate(made.places)}
    for index, (frame, descriptor) in enumerate(asked):
        match = recognizer.process(frame, descriptor)
        if match.reason in (Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY) or not match.best:
            continue
        said = judged[-1]
        if said.evidence is not None:
            where = number[match.best.reference_stamp_ns]
            yield said.evidence, said.share, said.balance, right[index, where]


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


def of_real(name: str, data: Path, darkened: float, folder: Path) -> Answers:
    """Yield the answers to a real drive, so much of its light taken."""
    config = make_config(EVERY_FRAME.spacing)
    whole = open_material(open_data_set(name, data), Cache(folder), config.encoding)
    change = picture_change('darken', darkened) if darkened else None
    query = replace(whole.query, change=change, changed_by=['darken', darkened])
    material = replace(whole, query=query, _drives={})
    drive, references = material.drives(config.encoding)
    asked = [
        (Frame(stamp_ns, None), one)
        for stamp_ns, one in zip(drive.stamps_ns, drive.descriptors, strict=True)
    ]
    right = material.truth.right | material.truth.slip
    for first, last in kept_halves(len(references)).values():
        part = part_of(references.reference_map, first, last)
        yield from answers(asked, part, right[:, first:last], config)


def show(name: str, found: np.ndarray) -> None:
    """Print a table."""
    said = np.array([confidence(*one) for one in found[:, :3]])
    print(f'{name}, {len(found)} answers')
    for row in reliability(said, found[:, 3] > 0):
        print('  {low:.2f} to {high:.2f}: {count} said {said:.3f} right {right:.3f}'.format(**row))


def main(asked: list[str]) -> None:
    """Measure and print."""
    is_fit = '--fit' in asked
    data, *names = [one for one in asked if one != '--fit']
    pairs = [one for one in PAIRS if one.name in FITTED] if is_fit else CHECKS
    found = {
        pair.name: list(of_drawn(replace(pair, count=120)))
        for pair in pairs
        if not names or pair.name in names
    }
    with tempfile.TemporaryDirectory() as folder:
        for name in REAL:
            for darkened in (0.9,) if is_fit else (0.0, 0.8):
                if not names or name in names:
                    answered = list(of_real(name, Path(data), darkened, Path(folder)))
                    found[f'{name} {darkened}'] = answered
    tables = {name: np.array(rows, float) for name, rows in found.items()}
    for name, rows in tables.items():
        show(name, rows)
    drives = [rows for name, rows in tables.items() if not name.startswith((*REAL, 'check-terr'))]
    if drives:
        show('drawn drives', np.concatenate(drives))
    if is_fit:
        evidence, share, balance, right = np.concatenate([*tables.values()]).T
        even = balance**CONFIDENCE.power
        strength = np.log(np.maximum(evidence, 0) * even + CONFIDENCE.least_evidence)
        features = np.column_stack((np.ones(len(right)), strength, share**2 * even))
        print('offset, slope, track:', logistic_weights(features, right > 0, np.zeros(3)).round(2))


if __name__ == '__main__':
    main(sys.argv[1:])
