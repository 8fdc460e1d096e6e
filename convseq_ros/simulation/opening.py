# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Windows, doors and shops."""

from convseq_ros.simulation.light import Colour
from convseq_ros.simulation.texture import any_colour, shade_of, Sheet
import numpy as np

WARM: Colour = (120, 190, 235)
_LETTERS = np.array(list('ABCDEFGHIKLMNOPRSTUVWZ'))


def word(rng: np.random.Generator, shortest: int, longest: int) -> str:
    """Return a random word in capitals."""
    return ''.join(rng.choice(_LETTERS, rng.integers(shortest, longest + 1)))


def paint_window(
    sheet: Sheet,
    rng: np.random.Generator,
    style: np.random.Generator,
    x: float,
    z: float,
    width: float,
    height: float,
) -> None:
    """Paint one window; `style` is the same for all windows of a house."""
    frame = any_colour(style, (0.0, 0.14), (0.25, 1.0))
    rim, sill, shutters, bars = style.uniform(size=4)
    surround = 0.06 + 0.14 * rim
    edge = any_colour(style, (0.0, 0.2), (0.4, 1.0))
    sheet.box(x - surround, z - surround, width + 2 * surround, height + 2 * surround, edge)
    lit = rng.uniform() < 0.36
    glass = shade_of((96, 80, 66), rng.uniform(0.45, 1.7))
    shine = shade_of(WARM, rng.uniform(0.35, 1.0)) if lit else None
    sheet.box(x, z, width, height, glass, shine)
    tall, wide = rng.uniform(0.2, 0.9), rng.uniform(0.12, 0.38)
    cloth = any_colour(rng, (0.0, 0.22), (0.55, 1.0))
    dim = shade_of(cloth, 0.55) if lit else None
    match rng.integers(5):
        case 0:
            sheet.box(x, z + height * (1 - tall), width, height * tall, cloth, dim)
        case 1:
            sheet.box(x, z, width * wide, height, cloth, dim)
            sheet.box(x + width * (1 - wide), z, width * wide, height, cloth, dim)
        case 2:
            slant = [(x, z + height * tall), (x + width, z + height), (x, z + height)]
            sheet.polygon(slant, shade_of(glass, 1.8), shine)
        case 3:
            pot = any_colour(rng, (0.3, 0.9), (0.2, 0.8))
            sheet.box(x + 0.2 * width, z, 0.3 * width, height * wide, pot)
    for share in np.arange(1, 1 + int(1 + 2.4 * bars)) / (1 + int(1 + 2.4 * bars)):
        sheet.box(x + share * width - 0.03, z, 0.06, height, frame)
    if bars > 0.4:
        sheet.box(x, z + height * 0.62, width, 0.06, frame)
    if sill > 0.3:
        sheet.box(x - 0.15, z - 0.16, width + 0.3, 0.13, shade_of(edge, 1.15))
        sheet.box(x - 0.15, z - 0.22, width + 0.3, 0.06, (50, 50, 50))
    if sill > 0.5 and rng.uniform() < 0.45:
        for _ in range(14):
            flower = any_colour(rng, (0.5, 1.0), (0.3, 0.9))
            at = x + rng.uniform(0, width), z + rng.uniform(-0.12, 0.15)
            sheet.disc(*at, rng.uniform(0.05, 0.12), flower)
    if shutters > 0.68:
        paint = any_colour(style, (0.2, 0.7), (0.2, 0.7))
        for side in (x - 0.5 * width - surround, x + width + surround):
            sheet.box(side, z, 0.5 * width, height, paint)
            for slat in np.arange(z + 0.1, z + height, 0.16):
                sheet.box(side + 0.05, slat, 0.5 * width - 0.1, 0.05, shade_of(paint, 0.7))


def paint_shop(sheet: Sheet, rng: np.random.Generator, x: float, width: float) -> None:
    """Paint a shop between x and x + width on the ground floor."""
    paint = any_colour(rng, (0.3, 0.9), (0.2, 0.9))
    sheet.box(x, 0.0, width, 3.1, shade_of(paint, 0.8))
    panes = int(rng.integers(2, 5))
    for pane in range(panes):
        left, size = x + 0.15 + pane * (width - 0.15) / panes, (width - 0.15) / panes - 0.15
        low = 0.05 if pane == panes // 2 else rng.uniform(0.3, 0.8)
        shine = shade_of((190, 220, 240), rng.uniform(0.3, 0.9))
        sheet.box(left, low, size, 2.3 - low, shade_of((90, 80, 72), rng.uniform(0.5, 1.4)), shine)
        for _ in range(int(rng.integers(3, 9))):
            goods = any_colour(rng, (0.2, 0.9), (0.2, 1.0))
            high = rng.uniform(0.1, 0.9)
            at = left + rng.uniform(0, max(0.05, size - 0.5)), low + rng.uniform(0, 0.9)
            sheet.box(*at, rng.uniform(0.1, 0.5), high, goods, shade_of(goods, 0.7))
    board = any_colour(rng, (0.1, 0.9), (0.15, 1.0))
    ink: Colour = (245, 245, 245) if sum(board) < 380 else (30, 30, 30)
    sheet.box(x, 2.45, width, 0.65, board, shade_of(board, 0.6))
    letters = max(2, min(9, int(width / 0.55)))
    sheet.text(x + rng.uniform(0.1, 0.5), 2.6, 0.34, word(rng, 2, letters), ink)
    if rng.uniform() < 0.5:
        stripes = max(4, int(width / 0.4))
        for stripe in range(stripes):
            tone = paint if stripe % 2 else (225.0, 230.0, 232.0)
            edge = x + stripe * width / stripes
            sheet.box(edge, 1.95, width / stripes, 0.55, shade_of(tone, 0.95))


def paint_ground_floor(
    sheet: Sheet, rng: np.random.Generator, wall: Colour, style_seed: int, storey: float
) -> None:
    """Paint shops, doors, windows and what people left on the wall."""
    width = sheet.width_m
    sheet.box(0, 0, width, rng.uniform(0.3, 1.0), shade_of(wall, rng.uniform(0.45, 0.8)))
    at = rng.uniform(0.2, 0.8)
    while at < width - 1.4:
        kind = rng.uniform()
        if kind < 0.36 and width - at > 3.4:
            size = min(width - at - 0.2, rng.uniform(3.2, 7.0))
            paint_shop(sheet, rng, at, size)
        elif kind < 0.6:
            size = rng.uniform(1.0, 1.5)
            paint = any_colour(rng, (0.2, 0.8), (0.15, 0.8))
            sheet.box(at - 0.12, 0, size + 0.24, 2.6, any_colour(rng, (0.0, 0.2), (0.5, 1.0)))
            sheet.box(at, 0, size, 2.45, paint)
            sheet.box(at + 0.15, 1.3, size - 0.3, 0.8, shade_of(paint, 0.5), (60, 110, 140))
            sheet.box(at + 0.15, 0.25, size - 0.3, 0.8, shade_of(paint, 1.3))
            sheet.text(at + size + 0.15, 1.8, 0.16, str(rng.integers(1, 400)), (20, 20, 20))
        elif kind < 0.72 and width - at > 3.0:
            size = 2.5
            paint = any_colour(rng, (0.0, 0.5), (0.3, 0.8))
            sheet.box(at, 0, size, 2.4, paint)
            for slat in np.arange(0.15, 2.4, rng.uniform(0.2, 0.5)):
                sheet.box(at, slat, size, 0.05, shade_of(paint, 0.65))
        else:
            size = rng.uniform(1.0, 1.8)
            style = np.random.default_rng(style_seed)
            paint_window(sheet, rng, style, at, 0.95, size, min(1.5, storey - 1.5))
        at += size + rng.uniform(0.4, 1.4)
    for _ in range(rng.poisson(1.2)):
        at, ink = rng.uniform(0.0, width), any_colour(rng, (0.5, 1.0), (0.2, 0.9))
        if rng.uniform() < 0.5:
            scrawl = rng.uniform(-0.6, 0.6, (7, 2)) * (1.0, 0.6) + (at, 1.1)
            sheet.line([(float(x), float(z)) for x, z in scrawl], 0.07, ink)
        else:
            sheet.box(at, 1.0, 0.5, 0.75, (225, 228, 230))
            sheet.box(at + 0.05, 1.2 + rng.uniform(0, 0.2), 0.4, 0.3, ink)
            sheet.text(at + 0.04, 1.06, 0.09, word(rng, 3, 5), (40, 40, 40))
