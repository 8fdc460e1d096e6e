# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Paints the fronts of houses: walls, windows, doors, shops and roofs, each different."""

from convseq_ros.simulation.light import Colour, Floats
from convseq_ros.simulation.texture import any_colour, cloud, shade_of, Sheet
import cv2
import numpy as np

WARM: Colour = (120, 190, 235)
_LETTERS = np.array(list('ABCDEFGHIKLMNOPRSTUVWZ'))


def word(rng: np.random.Generator, shortest: int, longest: int) -> str:
    return ''.join(rng.choice(_LETTERS, rng.integers(shortest, longest + 1)))


def paint_window(
    sheet: Sheet,
    rng: np.random.Generator,
    style_seed: int,
    x: float,
    z: float,
    width: float,
    height: float,
) -> None:
    """Paint one window; `style_seed` is the same for all windows of a house."""
    style = np.random.default_rng(style_seed)
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
    """Paint shops, doors, windows and graffiti."""
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
            paint_window(sheet, rng, style_seed, at, 0.95, size, min(1.5, storey - 1.5))
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


_WALLS: tuple[Colour, ...] = (
    (70, 88, 150), (60, 76, 128), (92, 112, 168), (150, 190, 214), (178, 204, 220),
    (196, 206, 212), (168, 176, 180), (128, 158, 182), (120, 168, 202), (150, 170, 150),
    (184, 168, 148), (150, 150, 196), (104, 128, 148), (140, 196, 226), (210, 216, 218),
)  # fmt: skip
_ROOFS: tuple[Colour, ...] = (
    (58, 70, 120), (70, 72, 78), (86, 84, 82), (64, 90, 140), (74, 84, 96),
)  # fmt: skip


def _paint_wall(sheet: Sheet, rng: np.random.Generator, wall: Colour) -> None:
    relief = _wall_relief(sheet, rng)
    sheet.image[..., :3] = np.clip(relief[..., None] * np.array(wall, np.float32), 0, 255)
    sheet.image[..., 3] = 255


def _wall_relief(sheet: Sheet, rng: np.random.Generator) -> Floats:
    """Return the brightness of each point of a wall of bricks, blocks, boards or plaster."""
    (height, width), resolution = sheet.image.shape[:2], sheet.resolution
    relief = 1.0 + rng.uniform(0.04, 0.10) * cloud(rng, height, width)
    kind = rng.choice(('brick', 'block', 'board', 'plaster', 'plaster'))
    if kind == 'plaster':
        return relief
    row_m, column_m, spread = {
        'brick': (rng.uniform(0.14, 0.22), rng.uniform(0.30, 0.50), 0.12),
        'block': (rng.uniform(0.35, 0.70), rng.uniform(0.60, 1.40), 0.07),
        'board': (rng.uniform(0.15, 0.30), 3.0, 0.09),
    }[str(kind)]
    rows = np.arange(height) / (row_m * resolution)
    columns = np.arange(width) / (column_m * resolution)
    row = rows.astype(int)
    column = columns[None, :] + 0.5 * (row[:, None] % 2)
    tones = rng.normal(1.0, spread, (row[-1] + 1, int(columns[-1]) + 2)).astype(np.float32)
    relief *= tones[row[:, None], column.astype(int)]
    joint = rng.choice((0.72, 0.82, 1.16))
    relief[(rows % 1.0) * row_m * resolution < 1.2] *= joint
    relief[(column % 1.0) * column_m * resolution < 1.2] *= joint
    return relief


def _roof(sheet: Sheet, rng: np.random.Generator, eaves: float) -> None:
    """Paint the roof above the eaves; the sky stays transparent."""
    width, rise = sheet.width_m, sheet.height_m - eaves
    colour = shade_of(_ROOFS[rng.integers(len(_ROOFS))], rng.uniform(0.8, 1.3))
    lean = rng.uniform(0.0, 0.8)
    top = eaves + rise * 0.72
    for _ in range(int(rng.integers(1, 4))):
        at, wide = rng.uniform(0.1, 0.85) * width, rng.uniform(0.4, 1.0)
        height = rise * rng.uniform(0.15, 0.26)
        brick = shade_of((70, 84, 130), rng.uniform(0.6, 1.3))
        sheet.box(at, top - 0.3, wide, height + 0.3, brick)
        sheet.box(at - 0.06, top + height - 0.1, wide + 0.12, 0.1, (60, 60, 64))
    sheet.polygon([(0, eaves), (width, eaves), (width - lean, top), (lean, top)], colour)
    for course in np.arange(eaves + 0.15, top, rng.uniform(0.2, 0.35)):
        sheet.line([(0.8, course), (width - 0.8, course)], 0.03, shade_of(colour, 0.8))
    for at in np.arange(1.2, width - 2.0, rng.uniform(2.2, 4.5)):
        if rng.uniform() < 0.6:
            sheet.box(at - 0.1, eaves + 0.3, 1.2, 1.2, (205, 210, 212))
            shine = shade_of(WARM, 0.8) if rng.uniform() < 0.4 else None
            sheet.box(at, eaves + 0.4, 1.0, 0.95, (70, 62, 58), shine)
            sheet.polygon(
                [(at - 0.3, eaves + 1.4), (at + 1.3, eaves + 1.4), (at + 0.5, eaves + 1.95)],
                shade_of(colour, 0.75),
            )


def _gable(sheet: Sheet, rng: np.random.Generator, eaves: float, wall: Colour) -> None:
    """Cut a pointed, stepped or flat top out of the wall."""
    width, rise = sheet.width_m, sheet.height_m - eaves
    kind = rng.integers(3)
    upper = [(width, eaves + 0.4 * rise), (0.0, eaves + 0.4 * rise)]
    if kind == 0:
        upper = [(width, eaves), (width / 2, eaves + rise), (0.0, eaves)]
    outline = [(0.0, 0.0), (width, 0.0), *upper]
    if kind == 1:
        steps = int(rng.integers(3, 6))
        left = [
            (i * width / 2 / steps + j * 0.001, eaves + (i + j) * rise * 0.9 / steps)
            for i in range(steps)
            for j in (0, 1)
        ]
        right = [(width - x, z) for x, z in reversed(left)]
        outline = [(0.0, 0.0), *left, *right, (width, 0.0)]
    mask = Sheet(width, sheet.height_m, sheet.resolution)
    mask.polygon(outline, (255, 255, 255))
    sheet.image[:] = cv2.multiply(sheet.image, mask.image, scale=1 / 255)
    edge = shade_of(wall, rng.choice((0.6, 1.25)))
    sheet.line(outline[2:-1] if kind != 1 else outline[1:-1], 0.22, edge)
    if kind == 2:
        for at in np.arange(0.2, width, rng.uniform(0.4, 0.9)):
            sheet.box(at, eaves + 0.4 * rise - 0.5, 0.2, 0.35, shade_of(edge, 0.7))


def paint_facade(rng: np.random.Generator, sheet: Sheet, floors: int, eaves: float) -> None:
    """Paint the front of a house, its ground floor included, whose wall is `eaves` metres high."""
    width = sheet.width_m
    wall = shade_of(_WALLS[rng.integers(len(_WALLS))], rng.uniform(0.75, 1.12))
    _paint_wall(sheet, rng, wall)
    if rng.uniform() < 0.5:
        sheet.image[: sheet.image.shape[0] - round(eaves * sheet.resolution)] = 0
        _roof(sheet, rng, eaves)
        cornice = any_colour(rng, (0.0, 0.2), (0.5, 1.0))
        sheet.box(0, eaves - 0.25, width, 0.3, cornice)
        sheet.box(0, eaves - 0.33, width, 0.08, (70, 70, 70))
    else:
        _gable(sheet, rng, eaves, wall)
    storey = eaves / floors
    style_seed = int(rng.integers(1 << 31))
    pitch, share = rng.uniform(1.7, 3.4), rng.uniform(0.38, 0.6)
    tall = rng.uniform(0.42, 0.62) * storey
    count = max(1, int((width - 0.6) / pitch))
    pitch = width / count
    for floor in range(1, floors):
        if rng.uniform() < 0.25:
            sheet.box(0, floor * storey - 0.1, width, 0.16, shade_of(wall, rng.uniform(0.6, 1.3)))
        for column in range(count):
            if rng.uniform() < 0.06:
                continue
            at = (column + 0.5 - share / 2) * pitch
            paint_window(sheet, rng, style_seed, at, (floor + 0.28) * storey, share * pitch, tall)
            if rng.uniform() < 0.07:
                rail = any_colour(rng, (0.0, 0.4), (0.1, 0.5))
                base = floor * storey + 0.05
                sheet.box(at - 0.4, base, share * pitch + 0.8, 0.15, (130, 134, 138))
                for bar in np.arange(at - 0.4, at + share * pitch + 0.4, 0.14):
                    sheet.box(bar, base + 0.15, 0.05, 0.85, rail)
                sheet.box(at - 0.4, base + 1.0, share * pitch + 0.8, 0.07, rail)
    paint_ground_floor(sheet, rng, wall, style_seed, storey)
    for _ in range(int(rng.integers(0, 3))):
        at = rng.uniform(0.05, 0.95) * width
        sheet.line([(at, 0.0), (at, eaves - 0.2)], 0.1, shade_of(wall, rng.choice((0.5, 0.7))))
    sheet.grain(rng, 0.05)


def paint_side(rng: np.random.Generator, sheet: Sheet) -> None:
    """Paint the side of a house: few windows, sometimes a large advertisement."""
    wall = shade_of(_WALLS[rng.integers(len(_WALLS))], rng.uniform(0.6, 1.0))
    _paint_wall(sheet, rng, wall)
    if rng.uniform() < 0.4 and sheet.height_m > 5:
        board = any_colour(rng, (0.2, 0.8), (0.3, 1.0))
        sheet.box(0.8, sheet.height_m - 4.2, sheet.width_m * 0.6, 3.4, board, shade_of(board, 0.2))
        written, ink = word(rng, 3, 5), any_colour(rng, (0.0, 0.3), (0.9, 1.0))
        sheet.text(1.0, sheet.height_m - 2.4, 0.8, written, ink)
    else:
        style_seed = int(rng.integers(1 << 31))
        for storey in np.arange(1.0, sheet.height_m - 2.0, 3.0):
            for at in np.arange(0.8, sheet.width_m - 1.2, rng.uniform(2.0, 4.5)):
                if rng.uniform() < 0.5:
                    paint_window(sheet, rng, style_seed, at, storey, 0.9, 1.3)


def paint_block(rng: np.random.Generator, sheet: Sheet) -> None:
    """Paint a large building of the second row, seen from afar."""
    wall = shade_of(_WALLS[rng.integers(len(_WALLS))], rng.uniform(0.7, 1.0))
    sheet.box(0, 0, sheet.width_m, sheet.height_m, wall)
    across, up = rng.uniform(1.8, 4.0), rng.uniform(2.6, 3.4)
    for x in np.arange(0.8, sheet.width_m - across * 0.6, across):
        for z in np.arange(1.0, sheet.height_m - 2.0, up):
            shine = shade_of(WARM, 0.7) if rng.uniform() < 0.3 else None
            glass = shade_of((90, 80, 70), rng.uniform(0.6, 1.6))
            sheet.box(x, z, across * 0.55, up * 0.55, glass, shine)
    sheet.grain(rng, 0.06)
