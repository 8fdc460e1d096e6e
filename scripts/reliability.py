# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how often answers of each confidence range are right, accepted or not.

Usage: python scripts/reliability.py, a few minutes. The drives through drawn streets were never
used for fitting; each is matched with two halves of its map and with the map of another street.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from convseq_ros import build_map, Frame, PlaceRecognizer
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.evaluation.metrics import EDGES, reliability
from convseq_ros.evaluation.protocols import kept_halves
from convseq_ros.evaluation.truth import Truth
from convseq_ros.simulation.layout import Layout, STRETCH_M
from convseq_ros.simulation.light import Light
from convseq_ros.simulation.street import Street, Stretch
import cv2
from drives import PASSED_OVER, shots
import numpy as np

LEAST = 50  # frames of a bin, below which its gap does not count
FRAMES, SPEED_MPS = 120, 10.0
PERIOD = 2  # of a terrace, in stretches
LOW_PX = 160, 120  # of a small sensor
Answers = Iterator[tuple[float, bool]]  # confidence, and whether right or a slip


@dataclass(frozen=True)
class Pair:
    """A street with a drive by day, which is its map, and a query drive."""

    name: str
    seed: int
    light: str
    step_m: float = 2.0
    offset_m: float = -1.5
    noise: float = 0.0
    is_low: bool = False  # whether both drives have a small sensor
    is_wet: bool = False  # whether it rains on the query drive, which is blurred
    is_terrace: bool = False


PAIRS = (
    Pair('check-evening', 602, 'evening', offset_m=0.0),
    Pair('check-night', 603, 'night'),
    Pair('check-night-noise', 604, 'night', noise=40),
    Pair('check-night-lane', 605, 'night', 1.0, offset_m=1.0, noise=15),
    Pair('check-low', 606, 'overcast', noise=20, is_low=True),
    Pair('check-low-night', 607, 'night', 1.0, noise=50, is_low=True),
    Pair('check-rain', 608, 'evening', is_wet=True),
    Pair('check-terrace', 612, 'evening', is_terrace=True),
)


class Terrace(Street):
    """A street whose left side repeats; its right side, cars, trees and signs differ."""

    def stretch(self, index: int, light: Light) -> Stretch:
        """Return a stretch, as `Street.stretch`."""
        repeated, own = (Layout(self.seed, at, light) for at in (index % PERIOD, index))
        shift_m = (index - index % PERIOD) * STRETCH_M
        left = [
            replace(
                panel,
                start=(panel.start[0] + shift_m, panel.start[1]),
                end=(panel.end[0] + shift_m, panel.end[1]),
                lamps=[(x + shift_m, y) for x, y in panel.lamps],
            )
            for panel in repeated.houses(1)
        ]
        buildings = [*own.second_row(), *left, *own.houses(-1)]
        return Stretch(
            buildings, [*own.lamps(), *own.plants(), *own.parked(), *own.signs()], own.ground
        )


def wet(gray: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an image with rain, drops on the lens, and motion blur."""
    height, width = gray.shape
    streaks, drops = np.zeros_like(gray), np.zeros_like(gray)
    for _ in range(gray.size // 500):
        x, y, long, lean = rng.integers((0, 0, 6, -2), (width, height, 20, 3)).tolist()
        cv2.line(streaks, (x, y), (x + lean, y + long), int(rng.integers(20, 70)), 1)
    for _ in range(14):
        x, y, radius = rng.integers((0, 0, 4), (width, height, 14)).tolist()
        cv2.circle(drops, (x, y), radius, 255, -1)
    rain = cv2.addWeighted(gray, 0.75, cv2.blur(streaks, (2, 2)), 1.0, 35)
    rain = np.where(drops > 0, cv2.GaussianBlur(rain, (0, 0), 5), rain)
    return cv2.blur(rain, (int(rng.integers(3, 15)) | 1, 1))


def drawn(pair: Pair, is_query: bool) -> tuple[list[Frame], np.ndarray]:
    """Return the frames of the map drive or of the query drive, and their distances."""
    street = Terrace(1000.0, pair.seed) if pair.is_terrace else Street(1000.0, pair.seed)
    later = {'light': pair.light, 'noise': pair.noise} if is_query else {}
    shown = shots(
        street, speed_mps=SPEED_MPS, frame_rate_hz=SPEED_MPS / pair.step_m, num_frames=FRAMES,
        lane_offset_m=pair.offset_m if is_query else -1.5, seed=2 * pair.seed + is_query, **later,
    )  # fmt: skip
    rng, frames = np.random.default_rng((pair.seed, is_query)), []
    for _, frame in shown:
        gray = frame.gray
        if pair.is_low:
            gray = cv2.resize(gray, LOW_PX, interpolation=cv2.INTER_AREA)
        if pair.is_wet and is_query:
            gray = wet(gray, rng)
        frames.append(replace(frame, gray=gray))
    return frames, np.array([at for at, _ in shown])


def answers(frames: list[Frame], mapped: ReferenceMap, right: np.ndarray) -> Answers:
    """Yield confidence and correctness of each keyframe's answer."""
    recognizer = PlaceRecognizer(mapped)
    number = {place.stamp_ns: index for index, place in enumerate(mapped.places)}
    for index, frame in enumerate(frames):
        match = recognizer.process(frame)
        if match.reason in PASSED_OVER or not match.best or match.confidence is None:
            continue
        yield match.confidence, right[index, number[match.best.reference_stamp_ns]]


def of_pair(pair: Pair) -> Answers:
    """Yield the answers to a drawn drive."""
    frames, there = drawn(pair, True)
    references, here = drawn(pair, False)
    away = abs(there[:, None] - here)
    near = abs(away.argmin(axis=1)[:, None] - np.arange(len(here))) <= 2
    right = near & (away.min(axis=1) <= 0.75 * pair.step_m)[:, None]
    right |= Truth(right).slip
    halves = kept_halves(len(references))
    for first, last in (halves['first'], halves['middle']):
        # `build_map` leaves frames out, so rows are assigned by stamps.
        mapped = build_map(references[first:last])
        index = {one.stamp_ns: place for place, one in enumerate(references)}
        kept = [index[place.stamp_ns] for place in mapped.places]
        yield from answers(frames, mapped, right[:, kept])
    elsewhere, _ = drawn(replace(pair, seed=pair.seed + 5000, is_terrace=False), False)
    mapped = build_map(elsewhere)
    yield from answers(frames, mapped, np.zeros((len(frames), len(mapped)), bool))


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
    tables = {pair.name: np.array(list(of_pair(pair)), float) for pair in PAIRS}
    for name, rows in (*tables.items(), ('all', np.concatenate([*tables.values()]))):
        show(name, rows)


if __name__ == '__main__':
    main()
