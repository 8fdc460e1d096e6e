# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what `min_evidence` comes from: false and right evidence on drawn drives.

Usage: python scripts/fit_acceptance.py [NAME...], about half an hour on two cores for all of
acceptance_drives.py. Every query is asked with half of the map removed (the first, the last and
the middle half kept in turn) and in the map of another street, and both drives against their own
past (40 m and 20 frames at least). Maps are made of keyframes, as the product makes them, and
only keyframes are counted. With `min_evidence` as it is, right answers less ten times the
false ones are most, over these drives and real images made dark. The left side of a terrace
repeats every 48 or 96 m: no threshold tells such places apart, so they do not count.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
import math
from multiprocessing import Pool
import sys

from acceptance_drives import drawn, FORK_M, judgements, Pair, PAIRS, ROUND_M
from convseq_ros.config import make_config
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Reason
from convseq_ros.evaluation.protocols import kept_halves
from convseq_ros.evaluation.truth import Truth
import numpy as np

OTHERS_M = 40.0
OTHERS_FRAMES = 20
ENCODING = make_config({}).encoding
Flags = np.ndarray


def answers(
    frames: list[Frame],
    references: list[Frame],
    made: ReferenceMap,
    right: Flags,
    slip: Flags,
    **settings: object,
) -> Iterator:
    """Yield of each keyframe: evidence, whether its track was consistent, right, slip, known."""
    recognizer = PlaceRecognizer(made, make_config(settings))
    number = {frame.stamp_ns: index for index, frame in enumerate(references)}
    judged = judgements(recognizer)
    for index, frame in enumerate(frames):
        match = recognizer.process(frame)
        if match.reason in (Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY):
            continue
        best, evidence, hit, slipped = match.best, math.nan, False, False
        if best is not None and judged[-1].evidence is not None:
            evidence = judged[-1].evidence
            place = number[best.reference_stamp_ns]
            hit, slipped = right[index, place], slip[index, place]
        consistent = match.reason is not Reason.INCONSISTENT
        yield evidence, consistent, hit, slipped, right[index].any()


def against_past(pair: Pair, frames: list[Frame], right: Flags | None = None) -> Iterator:
    """Yield the answers to a drive in a map that grows from it."""
    step_s = (frames[1].stamp_ns - frames[0].stamp_ns) / 1e9
    recent = OTHERS_FRAMES
    if pair.kind != 'loop':
        recent = max(recent, round(OTHERS_M / pair.step_m))
    settings = {'mode': 'online', 'exclusion_s': (recent - 0.5) * step_s, 'thumbnail_width_px': 0}
    if right is None:
        right = np.zeros((len(frames), len(frames)), bool)
    made = ReferenceMap(ENCODING)
    return answers(frames, frames, made, right, Truth(right).slip, **settings)


def in_map(frames: list[Frame], references: list[Frame], right: Flags, slip: Flags) -> Iterator:
    """Yield the answers to a drive in a map of the keyframes of another."""
    return answers(frames, references, build_map(references), right, slip)


def measured(pair: Pair) -> dict[str, np.ndarray]:
    """Return the answers of every run of a pair, (N, 5)."""
    frames, there = drawn(pair, True)
    if pair.kind == 'loop':
        before = there[:, None] - there - ROUND_M
        index = np.arange(len(frames))
        right = (abs(before) <= 2.75 * pair.step_m) & (index[:, None] - index >= OTHERS_FRAMES)
        return {f'{pair.name} online': np.array(list(against_past(pair, frames, right)), float)}
    references, here = drawn(pair, False)
    if pair.kind == 'fork':
        there = np.where(there > FORK_M, np.inf, there)
    away = abs(there[:, None] - here)
    near = abs(away.argmin(axis=1)[:, None] - np.arange(len(here))) <= 2
    right = near & (away.min(axis=1) <= 0.75 * pair.step_m)[:, None]
    slip = Truth(right).slip
    elsewhere, _ = drawn(replace(pair, seed=pair.seed + 5000, kind='street'), False)
    nowhere = np.zeros((len(frames), len(elsewhere)), bool)
    back = [
        replace(one, stamp_ns=two.stamp_ns)
        for one, two in zip(reversed(references), references, strict=True)
    ]
    runs = {
        half: in_map(frames, references[a:b], right[:, a:b], slip[:, a:b])
        for half, (a, b) in kept_halves(len(references)).items()
    }
    runs['elsewhere'] = in_map(frames, elsewhere, nowhere, nowhere)
    runs['past'] = against_past(pair, frames)
    runs['map-past'] = against_past(pair, back)
    return {f'{pair.name} {name}': np.array(list(run), float) for name, run in runs.items()}


def main(names: list[str]) -> None:
    """Measure and print."""
    chosen = [pair for pair in PAIRS if not names or pair.name in names]
    with Pool(2) as pool:
        found = dict(zip(chosen, pool.imap(measured, chosen), strict=True))
    steps = {'1 m a frame or more': (1, 99), 'less': (0, 1)}
    for name, (least, most) in steps.items():
        some = [
            runs
            for pair, runs in found.items()
            if least <= pair.step_m < most and not pair.kind.startswith('terrace')
        ]
        runs = dict(chain.from_iterable(one.items() for one in some))
        if runs:
            print_evidence(name, runs)


def print_evidence(name: str, runs: dict[str, np.ndarray]) -> None:
    """Print how many answers are right and false at some thresholds, and the largest false."""
    every = np.concatenate(list(runs.values()))
    evidence, consistent, right, slip, known = every.T
    false = (right + slip == 0) & (consistent > 0)
    print(f'{name}: {len(every)} frames, {int(known.sum())} of known places')
    for least in (1.0, 1.2, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9, 2.0):
        taken = evidence >= least
        hit = (taken & (consistent > 0) & (right > 0)).sum() / max(known.sum(), 1)
        print(f'  {least:.1f}: recall {hit:.3f}, false {(taken & false).sum()}')
    tops = {
        run: np.nanmax(np.where((one[:, 2] + one[:, 3] == 0) & (one[:, 1] > 0), one[:, 0], 0))
        for run, one in runs.items()
    }
    worst = sorted(tops, key=lambda run: -tops[run])[:8]
    print('  largest false:', ', '.join(f'{run} {tops[run]:.2f}' for run in worst))


if __name__ == '__main__':
    main(sys.argv[1:])
