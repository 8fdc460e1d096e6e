# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Places all objects on one stretch of the street, reproducibly from a seed."""

from collections.abc import Iterator

from convseq_ros.simulation import facade, furniture
from convseq_ros.simulation import ground as road
from convseq_ros.simulation.ground import FRONT_M, GROUND_HALF_M, KERB_M
from convseq_ros.simulation.light import illuminate, Light
from convseq_ros.simulation.panel import Painter, Panel, Point
from convseq_ros.simulation.texture import Sheet, Texture
import numpy as np

STRETCH_M = 48.0
_CAR_M = 3.3
_HOUSE_DEPTH_M = 9.0
# For each object, in metres: half the width, the minimum and maximum height, the painter, and the
# distance up to which it is drawn.
_SIGN = 0.55, 2.4, 3.2, furniture.paint_sign, 80.0
_BIN = 0.35, 0.8, 1.5, furniture.paint_bin, 50.0
_HANGING = furniture.paint_hanging_sign


class Layout:
    """Places the objects of one stretch; `lamps_seed` and `repaint` (seed, share) make a twin."""

    def __init__(
        self,
        seed: int,
        index: int,
        light: Light,
        lamps_seed: int | None = None,
        repaint: tuple[int, float] = (0, 0.0),
    ) -> None:
        self._seed, self._index, self._light = seed, index, light
        self._lamps_seed, self._repaint = seed if lamps_seed is None else lamps_seed, repaint
        self._count = 0
        self._start = index * STRETCH_M
        self._lamps = [at for near in (-1, 0, 1) for at in self._lamp_places(index + near)]

    def _rng(self, topic: int, index: int | None = None) -> np.random.Generator:
        at = self._index if index is None else index
        return np.random.default_rng((self._seed, at + 1_000_000, topic))

    def _panel(
        self,
        start: Point,
        end: Point,
        bottom: float,
        top: float,
        paint: Painter,
        resolution: float = 32.0,
        visible_m: float = 170.0,
        facing: bool = False,
        gain: float | None = None,
        seed: int | None = None,
    ) -> Panel:
        self._count += 1
        seeds = (seed,) if seed is not None else self._paint_seeds()
        if gain is None:
            gain = (self._light.left if start[1] + end[1] > 0 else self._light.right) * 1.05
        drawn = visible_m, facing, resolution, seeds, paint, gain
        return Panel(start, end, bottom, top, *drawn, self._light, self._lamps)

    def _paint_seeds(self) -> tuple[int, ...]:
        """Return the seeds of the newest panel's picture."""
        at = self._index + 1_000_000, 99, self._count
        twin_seed, share = self._repaint
        repaints = share > 0 and np.random.default_rng((twin_seed, *at, 1)).uniform() < share
        return (twin_seed if repaints else self._seed, *at)

    def _lamp_places(self, index: int) -> list[Point]:
        rng = np.random.default_rng((self._lamps_seed, index + 1_000_000, 1))
        return [
            (index * STRETCH_M + 24.0 * i + rng.uniform(2, 22), side * (KERB_M + 0.4 - 1.2))
            for i, side in enumerate(rng.permutation((-1.0, 1.0)))
        ]

    def _bounds(self, side: int) -> Point:
        """Return where the first houses of this stretch and of the next one begin."""
        first, last = (self._rng(20 + side, self._index + i).uniform(-5, 5) for i in (0, 1))
        return self._start + first, self._start + STRETCH_M + last

    def houses(self, side: int) -> Iterator[Panel]:
        """Yield the fronts and sides of the houses on one side, with gaps."""
        rng = self._rng(30 + side)
        at, last = self._bounds(side)
        while last - at > 1.0:
            width = float(rng.uniform(5.5, 15.0))
            width = last - at if last - at < width + 5.5 else width
            y = side * (FRONT_M + float(rng.choice((0.0, 0.0, 0.3, 0.8, 1.6))))
            if rng.uniform() < 0.13:
                yield from self._garden(rng, side, at, width)
            else:
                yield from self._house(rng, side, at, width, y)
            at += width

    def _house(
        self, rng: np.random.Generator, side: int, x: float, width: float, y: float
    ) -> Iterator[Panel]:
        floors = int(rng.choice((1, 2, 2, 3, 3, 4, 5)))
        eaves = floors * float(rng.uniform(2.8, 3.4)) + 0.4
        top = eaves + float(rng.uniform(1.6, 3.4))
        gain = self._light.left if side > 0 else self._light.right

        def paint_front(rng: np.random.Generator, sheet: Sheet) -> None:
            facade.paint_facade(rng, sheet, floors, eaves)

        yield self._panel(*_front(side, x, width, y), 0.0, top, paint_front, gain=gain)
        right, left = sorted((y, y + side * _HOUSE_DEPTH_M))
        for start, end in (((x, left), (x, right)), ((x + width, right), (x + width, left))):
            yield self._panel(
                start, end, 0.0, eaves, facade.paint_side, resolution=16.0, gain=0.75 * gain
            )

    def _garden(
        self, rng: np.random.Generator, side: int, x: float, width: float
    ) -> Iterator[Panel]:
        y = side * (FRONT_M + 0.2)
        for _ in range(int(rng.integers(1, 4))):
            tree = x + float(rng.uniform(0.2, 0.8)) * width, y + side * float(rng.uniform(3, 8))
            yield self._tree(rng, *tree)
        ends, height = _front(side, x, width, y), float(rng.uniform(0.9, 2.2))
        yield self._panel(*ends, 0.0, height, furniture.paint_fence)

    def _tree(self, rng: np.random.Generator, x: float, y: float) -> Panel:
        height = float(rng.uniform(4.5, 9.0))
        half = height * float(rng.uniform(0.24, 0.36))
        return self._panel(
            (x, y - half), (x, y + half), 0.0, height, furniture.paint_tree, facing=True
        )

    def second_row(self) -> Iterator[Panel]:
        """Yield large buildings behind the houses."""
        rng = self._rng(40)
        for side in (-1, 1):
            at = self._start
            while at < self._start + STRETCH_M - 12:
                width, y = float(rng.uniform(10, 24)), side * float(rng.uniform(26, 40))
                width = min(width, self._start + STRETCH_M - at)
                ends = _front(side, at, width, y)
                yield self._panel(
                    *ends, 0.0, float(rng.uniform(8, 26)), facade.paint_block, resolution=10.0
                )
                at += width + float(rng.uniform(0, 14))

    def lamps(self) -> Iterator[Panel]:
        """Yield the street lamps, their arms over the road."""
        for x, y in self._lamp_places(self._index):
            side = np.sign(y)
            foot = y + side * 1.2
            ends = (x, foot + side * 0.15), (x, foot - side * 1.75)
            yield self._panel(*ends, 0.0, 6.1, furniture.paint_lamp, 40.0, visible_m=110.0)

    def plants(self) -> Iterator[Panel]:
        """Yield trees along the pavement, few or an avenue."""
        rng = self._rng(50)
        for side in (-1, 1):
            for _ in range(int(rng.choice((0, 1, 1, 2, 4)))):
                yield self._tree(
                    rng, self._start + float(rng.uniform(0, STRETCH_M)), side * (KERB_M + 1.0)
                )

    def _bays(self) -> Iterator[tuple[float, int, int]]:
        """Yield x, side and seed of every parked car."""
        rng = self._rng(60)
        for side in (-1, 1):
            for bay in range(8):
                shift, seed = float(rng.uniform(0.2, 1.4)), int(rng.integers(1 << 31))
                if rng.uniform() < 0.42:
                    yield self._start + 6.0 * bay + shift, side, seed

    def parked(self) -> Iterator[Panel]:
        """Yield parked cars: both ends and the visible side."""
        long = furniture.CAR_LENGTH_M
        for x, side, seed in self._bays():
            rng = np.random.default_rng(seed)
            inner, outer = side * _CAR_M, side * (_CAR_M + furniture.CAR_WIDTH_M)
            left, right = max(inner, outer), min(inner, outer)
            top = furniture.CAR_HEIGHT_M * float(rng.uniform(0.93, 1.25))
            for paint, start, end in (
                (furniture.paint_car_end, (x, left), (x, right)),
                (furniture.paint_car_end, (x + long, right), (x + long, left)),
                (furniture.paint_car_side, (x, inner), (x + long, inner)),
            ):
                gain, shown = self._light.ground, (48.0, 90.0)
                yield self._panel(start, end, 0.0, top, paint, *shown, gain=gain, seed=seed)

    def signs(self) -> Iterator[Panel]:
        """Yield traffic signs, bins and hanging shop signs."""
        rng = self._rng(70)
        for side in (-1, 1):
            for _ in range(int(rng.integers(1, 4))):
                x, y = self._start + float(rng.uniform(0, STRETCH_M)), side * (KERB_M + 0.6)
                kind = rng.uniform()
                if kind < 0.6:
                    half, low, high, paint, visible_m = _SIGN if kind < 0.4 else _BIN
                    ends, top = ((x, y + half), (x, y - half)), float(rng.uniform(low, high))
                    yield self._panel(*ends, 0.0, top, paint, 60.0, visible_m, facing=True)
                else:
                    near = side * (FRONT_M - float(rng.uniform(0.6, 1.2)))
                    low = float(rng.uniform(2.7, 4.5))
                    left, right = max(near, side * FRONT_M), min(near, side * FRONT_M)
                    heights, paint = (low, low + float(rng.uniform(0.5, 1.8))), _HANGING
                    yield self._panel((x, left), (x, right), *heights, paint, 60.0, 80.0)

    def ground(self) -> Texture:
        sheet = Sheet(STRETCH_M, 2 * GROUND_HALF_M, road.GROUND_RESOLUTION)
        half = furniture.CAR_WIDTH_M / 2
        size = furniture.CAR_LENGTH_M + 0.2, furniture.CAR_WIDTH_M + 0.4
        shadows = [
            (x - self._start - 0.1, GROUND_HALF_M + side * (_CAR_M + half) - half - 0.2, *size)
            for x, side, _ in self._bays()
        ]
        road.paint_ground(self._rng(80), sheet, shadows)
        rows, columns = sheet.image.shape[:2]
        where = (
            np.linspace(self._start, self._start + STRETCH_M, columns, dtype=np.float32)[None, :],
            np.linspace(GROUND_HALF_M, -GROUND_HALF_M, rows, dtype=np.float32)[:, None],
            np.zeros((1, 1), np.float32),
        )
        gain = self._light.ground
        return Texture(illuminate(sheet.image, None, self._light, gain, where, self._lamps))


def _front(side: int, x: float, width: float, y: float) -> tuple[Point, Point]:
    """Return the left and right ends of a front that faces the street."""
    ends = (x, y), (x + width, y)
    return ends if side > 0 else ends[::-1]
