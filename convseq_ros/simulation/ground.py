# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The road from above: asphalt and its repairs, markings, kerbs and pavement."""

from convseq_ros.simulation.light import Colour
from convseq_ros.simulation.texture import cloud, shade_of, Sheet
import cv2
import numpy as np

GROUND_HALF_M = 12.0
GROUND_RESOLUTION = 28.0
KERB_M, FRONT_M, PARKING_M = 5.2, 8.0, 3.1
_PAINT: Colour = (208, 214, 216)


def paint_ground(
    rng: np.random.Generator, sheet: Sheet, shadows: list[tuple[float, float, float, float]]
) -> None:
    """Paint a road from its right edge, with shadows (x, z, length, width), metres."""
    length, middle = sheet.width_m, GROUND_HALF_M
    shape = sheet.image.shape[:2]
    sheet.box(0, 0, length, 2 * middle, (86, 110, 104))
    slab = shade_of((150, 156, 160), rng.uniform(0.8, 1.1))
    sheet.box(0, middle - FRONT_M - 0.6, length, 2 * FRONT_M + 1.2, slab)
    _paint_slabs(rng, sheet, slab)
    asphalt = shade_of((98, 96, 94), rng.uniform(0.75, 1.15))
    sheet.box(0, middle - KERB_M, length, 2 * KERB_M, asphalt)
    for side in (-KERB_M - 0.18, KERB_M):
        sheet.box(0, middle + side, length, 0.18, (176, 182, 186))
        for joint in np.arange(0, length, 1.0):
            sheet.box(joint, middle + side, 0.04, 0.18, (100, 104, 106))
    _paint_repairs(rng, sheet, asphalt)
    _paint_markings(rng, sheet)
    rough = 1.0 + 0.055 * cloud(rng, *shape)
    shade = Sheet(length, 2 * middle, sheet.resolution)
    for x, z, long, wide in shadows:
        shade.box(x, z, long, wide, (150, 150, 150))
    rough *= 1.0 - cv2.blur(shade.image[..., 0], (9, 9)) / np.float32(255)
    sheet.image[..., :3] = np.clip(sheet.image[..., :3] * rough[..., None], 0, 255)


def _paint_slabs(rng: np.random.Generator, sheet: Sheet, slab: Colour) -> None:
    size, depth = rng.uniform(0.6, 1.3), rng.uniform(0.5, 0.95)
    for start in (GROUND_HALF_M - FRONT_M - 0.6, GROUND_HALF_M + KERB_M + 0.18):
        for across in np.arange(start, start + FRONT_M - KERB_M + 0.4, depth):
            for along in np.arange(0, sheet.width_m, size):
                tone = shade_of(slab, rng.normal(0.97, 0.06))
                sheet.box(along + 0.02, across + 0.02, size - 0.04, depth - 0.04, tone)


def _paint_repairs(rng: np.random.Generator, sheet: Sheet, asphalt: Colour) -> None:
    length, low = sheet.width_m, GROUND_HALF_M - KERB_M
    for _ in range(int(rng.integers(3, 10))):
        x, z = rng.uniform(0, length), low + rng.uniform(0, 2 * KERB_M - 1.5)
        size = rng.uniform(0.6, 7.0), rng.uniform(0.5, 2.2)
        if z + size[1] < GROUND_HALF_M + KERB_M:
            sheet.box(x, z, *size, shade_of(asphalt, 0.55))
            tone = shade_of(asphalt, rng.uniform(0.7, 1.2))
            sheet.box(x + 0.06, z + 0.06, size[0] - 0.12, size[1] - 0.12, tone)
    for _ in range(int(rng.integers(4, 12))):
        start = np.array([rng.uniform(0, length), low + rng.uniform(0.5, 2 * KERB_M - 0.5)])
        crack = start + np.cumsum(rng.normal(0, 0.3, (12, 2)) + rng.normal(0, 0.25, 2), axis=0)
        crack[:, 1] = crack[:, 1].clip(low + 0.1, GROUND_HALF_M + KERB_M - 0.1)
        sheet.line([(float(x), float(z)) for x, z in crack], 0.04, shade_of(asphalt, 0.5))
    for _ in range(int(rng.integers(1, 5))):
        x, z = rng.uniform(0, length), low + rng.uniform(0.6, 2 * KERB_M - 0.6)
        sheet.disc(x, z, 0.36, shade_of(asphalt, 0.5))
        sheet.disc(x, z, 0.3, shade_of(asphalt, rng.uniform(0.7, 1.3)))
        sheet.line([(x - 0.25, z), (x + 0.25, z)], 0.05, shade_of(asphalt, 0.5))
    for _ in range(int(rng.integers(3, 12))):
        x, z = rng.uniform(0, length), low + rng.uniform(0.3, 1.8)
        stain = z if rng.uniform() < 0.5 else 2 * GROUND_HALF_M - z
        sheet.disc(x, stain, rng.uniform(0.1, 0.5), shade_of(asphalt, 0.75))


def _paint_markings(rng: np.random.Generator, sheet: Sheet) -> None:
    length, middle = sheet.width_m, GROUND_HALF_M
    for at in np.arange(0.0, length, 6.0):
        sheet.box(at, middle - 0.07, 3.0, 0.14, shade_of(_PAINT, rng.uniform(0.75, 1.05)))
    for side in (-1, 1):
        if rng.uniform() < 0.6:
            for at in np.arange(rng.uniform(0, 5), length, 5.2):
                sheet.box(at, middle + side * 4.15 - 1.0, 0.1, 2.0, _PAINT)
        edge = middle + side * PARKING_M
        for at in np.arange(0.0, length, 1.0):
            sheet.box(at, edge - 0.05, 0.5, 0.1, shade_of(_PAINT, rng.uniform(0.7, 1.0)))
    if rng.uniform() < 0.3:
        at = rng.uniform(2.0, length - 6.0)
        sheet.box(at, middle - KERB_M, 4.0, 2 * KERB_M, (94, 92, 90))
        for bar in np.arange(middle - KERB_M + 0.3, middle + KERB_M - 0.4, 1.0):
            sheet.box(at + 0.3, bar, 3.4, 0.5, shade_of(_PAINT, rng.uniform(0.85, 1.05)))
    if rng.uniform() < 0.4:
        at, lane = rng.uniform(2.0, length - 6.0), middle - 1.6
        sheet.box(at, lane - 0.07, 2.2, 0.14, _PAINT)
        sheet.polygon([(at + 2.2, lane - 0.4), (at + 2.2, lane + 0.4), (at + 3.6, lane)], _PAINT)
