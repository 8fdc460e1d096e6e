# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn drives: PAIRS to fit on (fit_observation.py), CHECKS to measure on (reliability.py)."""

from dataclasses import dataclass, replace
from functools import lru_cache

from convseq_ros.core.types import Frame
from convseq_ros.simulation.layout import Layout, STRETCH_M
from convseq_ros.simulation.light import Light
from convseq_ros.simulation.street import Street, Stretch
import cv2
from drives import shots
import numpy as np

SPEED_MPS = 10.0
PERIOD = 2  # of a terrace, in stretches


@dataclass(frozen=True)
class Pair:
    """A street with a map drive and a query drive; `looks` are alterations of the images."""

    name: str
    seed: int
    step_m: float = 2.0
    speed: float = 1.0
    count: int = 150
    is_terrace: bool = False
    looks: tuple[str, ...] = ()
    both_look: tuple[str, ...] = ()
    light: str = 'day'
    offset_m: float = -1.5
    noise: float = 0.0
    heading_deg: float = 0.0


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


LOW, TINY = ('160',), ('64',)
PAIRS = (
    Pair('night', 101, light='night'),
    Pair('night-lane', 105, light='night', offset_m=1.5),
    Pair('tiny-night', 109, both_look=TINY, light='night'),
    Pair('fast', 116, speed=1.5, light='overcast'),
    Pair('night-noise-2', 232, light='night', noise=45),
    Pair('low-night-lane', 122, 1.0, both_look=LOW, light='night', offset_m=0.0),
    Pair('tiny-lane', 227, both_look=TINY, offset_m=0.0, noise=10),
    Pair('tiny-rain', 303, count=120, both_look=('rain', '64'), light='night'),
    Pair('rain-blur', 324, count=120, looks=('rain', 'blur'), light='night', noise=20),
    Pair('walk', 304, 0.5, count=120, light='evening', offset_m=-0.5),
    Pair('crawl', 307, 0.3, count=120, light='overcast', heading_deg=4),
    Pair('terrace-low', 215, 1.5, is_terrace=True, both_look=LOW, offset_m=0.5),
)  # fmt: skip

# Never used for fitting.
CHECKS = (
    Pair('check-evening', 602, count=120, light='evening', offset_m=0.0),
    Pair('check-night', 603, count=120, light='night'),
    Pair('check-night-noise', 604, count=120, light='night', noise=40),
    Pair('check-night-lane', 605, 1.0, count=120, light='night', offset_m=1.0, noise=15),
    Pair('check-low', 606, count=120, both_look=LOW, light='overcast', noise=20),
    Pair('check-low-night', 607, 1.0, count=120, both_look=LOW, light='night', noise=50),
    Pair('check-rain', 608, count=120, looks=('rain', 'blur'), light='evening'),
    Pair('check-terrace', 612, count=120, is_terrace=True, light='evening'),
)


def altered(gray: np.ndarray, look: str, rng: np.random.Generator) -> np.ndarray:
    """Return an image altered by rain, motion blur or a small sensor."""
    height, width = gray.shape
    if look in ('160', '64'):
        size = (160, 120) if look == '160' else (64, 32)
        return cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
    if look == 'blur':
        return cv2.blur(gray, (int(rng.integers(3, 15)) | 1, 1))
    streaks, drops = np.zeros_like(gray), np.zeros_like(gray)
    for _ in range(gray.size // 500):
        x, y, long, lean = rng.integers((0, 0, 6, -2), (width, height, 20, 3)).tolist()
        cv2.line(streaks, (x, y), (x + lean, y + long), int(rng.integers(20, 70)), 1)
    for _ in range(14):
        x, y, radius = rng.integers((0, 0, 4), (width, height, 14)).tolist()
        cv2.circle(drops, (x, y), radius, 255, -1)
    wet = cv2.addWeighted(gray, 0.75, cv2.blur(streaks, (2, 2)), 1.0, 35)
    return np.where(drops > 0, cv2.GaussianBlur(wet, (0, 0), 5), wet)


@lru_cache(maxsize=4)
def drawn(pair: Pair, is_query: bool) -> tuple[list[Frame], np.ndarray]:
    """Return the frames of the map drive or of the query drive, and their distances."""
    speed = pair.speed if is_query else 1.0
    street = Terrace(1000.0, pair.seed) if pair.is_terrace else Street(1000.0, pair.seed)
    shown = shots(
        street, speed_mps=SPEED_MPS * speed, frame_rate_hz=SPEED_MPS / pair.step_m,
        num_frames=int(pair.count / speed), lane_offset_m=pair.offset_m if is_query else -1.5,
        heading_deg=pair.heading_deg * is_query, light=pair.light if is_query else 'day',
        noise=pair.noise * is_query, seed=2 * pair.seed + is_query,
    )  # fmt: skip
    rng, frames = np.random.default_rng((pair.seed, is_query)), []
    for _, frame in shown:
        for look in (*pair.both_look, *(pair.looks if is_query else ())):
            frame = replace(frame, gray=altered(frame.gray, look, rng))
        frames.append(frame)
    return frames, np.array([at for at, _ in shown])
