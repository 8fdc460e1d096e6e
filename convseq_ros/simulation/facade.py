# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The fronts of houses: walls, windows, doors, shops and roofs, no two alike."""

from convseq_ros.simulation.light import Colour, Floats
from convseq_ros.simulation.opening import paint_ground_floor, paint_window, WARM, word
from convseq_ros.simulation.texture import any_colour, cloud, shade_of, Sheet
import cv2
import numpy as np

_WALLS: tuple[Colour, ...] = (
    (70, 88, 150), (60, 76, 128), (92, 112, 168), (150, 190, 214), (178, 204, 220),
    (196, 206, 212), (168, 176, 180), (128, 158, 182), (120, 168, 202), (150, 170, 150),
    (184, 168, 148), (150, 150, 196), (104, 128, 148), (140, 196, 226), (210, 216, 218),
)  # fmt: skip
_ROOFS: tuple[Colour, ...] = (
    (58, 70, 120), (70, 72, 78), (86, 84, 82), (64, 90, 140), (74, 84, 96),
)  # fmt: skip


def _wall_relief(rng: np.random.Generator, shape: tuple[int, int], resolution: float) -> Floats:
    """Return how bright each point of a wall is, from bricks, blocks, boards or plaster."""
    height, width = shape
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
    """Paint what stands above the eaves, leaving the sky free."""
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
    if kind == 0:
        upper = [(width, eaves), (width / 2, eaves + rise), (0.0, eaves)]
        outline = [(0.0, 0.0), (width, 0.0), *upper]
    elif kind == 1:
        steps = int(rng.integers(3, 6))
        left = [
            (i * width / 2 / steps + j * 0.001, eaves + (i + j) * rise * 0.9 / steps)
            for i in range(steps)
            for j in (0, 1)
        ]
        right = [(width - x, z) for x, z in reversed(left)]
        outline = [(0.0, 0.0), *left, *right, (width, 0.0)]
    else:
        upper = [(width, eaves + 0.4 * rise), (0.0, eaves + 0.4 * rise)]
        outline = [(0.0, 0.0), (width, 0.0), *upper]
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
    relief = _wall_relief(rng, sheet.image.shape[:2], sheet.resolution)
    sheet.image[..., :3] = np.clip(relief[..., None] * np.array(wall, np.float32), 0, 255)
    sheet.image[..., 3] = 255
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
            style = np.random.default_rng(style_seed)
            at = (column + 0.5 - share / 2) * pitch
            paint_window(sheet, rng, style, at, (floor + 0.28) * storey, share * pitch, tall)
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
    relief = _wall_relief(rng, sheet.image.shape[:2], sheet.resolution)
    sheet.image[..., :3] = np.clip(relief[..., None] * np.array(wall, np.float32), 0, 255)
    sheet.image[..., 3] = 255
    if rng.uniform() < 0.4 and sheet.height_m > 5:
        board = any_colour(rng, (0.2, 0.8), (0.3, 1.0))
        sheet.box(0.8, sheet.height_m - 4.2, sheet.width_m * 0.6, 3.4, board, shade_of(board, 0.2))
        written = word(rng, 3, 5)
        ink = any_colour(rng, (0.0, 0.3), (0.9, 1.0))
        sheet.text(1.0, sheet.height_m - 2.4, 0.8, written, ink)
    else:
        style_seed = int(rng.integers(1 << 31))
        for storey in np.arange(1.0, sheet.height_m - 2.0, 3.0):
            for at in np.arange(0.8, sheet.width_m - 1.2, rng.uniform(2.0, 4.5)):
                if rng.uniform() < 0.5:
                    style = np.random.default_rng(style_seed)
                    paint_window(sheet, rng, style, at, storey, 0.9, 1.3)


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
