# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Paints the objects along a street: trees, lamps, cars, signs, hedges."""

from convseq_ros.simulation.facade import word
from convseq_ros.simulation.light import Colour
from convseq_ros.simulation.texture import any_colour, shade_of, Sheet
import numpy as np

CAR_LENGTH_M, CAR_WIDTH_M, CAR_HEIGHT_M = 4.2, 1.75, 1.5
_RUBBER: Colour = (28, 28, 28)
_GLASS: Colour = (78, 66, 56)
_CARS: tuple[Colour, ...] = (
    (226, 228, 230), (186, 190, 192), (130, 132, 134), (72, 72, 74), (38, 38, 40),
    (40, 40, 170), (120, 70, 36), (90, 50, 30), (60, 90, 50), (150, 170, 180),
    (160, 130, 90), (40, 150, 215), (70, 60, 110), (60, 100, 140),
)  # fmt: skip


def paint_tree(rng: np.random.Generator, sheet: Sheet) -> None:
    """Paint a tree with a crown of many leaves."""
    width, height = sheet.width_m, sheet.height_m
    bark = shade_of((62, 84, 104), rng.uniform(0.7, 1.2))
    middle, fork = width / 2, height * rng.uniform(0.32, 0.45)
    foot = 0.12 + 0.012 * height
    trunk = [(middle - foot, 0.0), (middle + foot, 0.0)]
    trunk += [(middle + foot / 2, fork + 0.8), (middle - foot / 2, fork + 0.8)]
    sheet.polygon(trunk, bark)
    for angle in rng.uniform(-1.0, 1.0, 6):
        reach = rng.uniform(0.2, 0.4) * width
        sheet.line([(middle, fork), (middle + angle * reach, fork + reach * 1.2)], 0.09, bark)
    leaf = (rng.uniform(30, 75), rng.uniform(95, 150), rng.uniform(55, 135))
    centre, half = (height + fork) / 2 + 0.1, (height - fork) / 2 - 0.1
    clumps = rng.uniform(-0.72, 0.72, (9, 2))
    for step in range(520):
        clump = clumps[step % 9] if step % 3 else np.zeros(2)
        x, z = clump + rng.normal(0, 0.2, 2)
        norm = float(np.hypot(x, z))
        if norm > 0.95:
            continue
        brightness = 0.5 + 0.4 * (z + 1) / 2 + step / 1400 + rng.uniform(-0.12, 0.18)
        at = middle + x * (width / 2 - 0.15), centre + z * half
        sheet.disc(*at, rng.uniform(0.07, 0.24), shade_of(leaf, brightness))


def paint_lamp(rng: np.random.Generator, sheet: Sheet) -> None:
    """Paint a street lamp whose arm points to the right."""
    del rng
    steel: Colour = (74, 78, 76)
    height = sheet.height_m
    sheet.box(0.05, 0, 0.22, 1.1, shade_of(steel, 0.8))
    sheet.box(0.1, 0, 0.12, height - 0.3, steel)
    sheet.line([(0.16, height - 0.4), (0.5, height - 0.12), (1.3, height - 0.1)], 0.1, steel)
    sheet.box(1.0, height - 0.26, 0.75, 0.2, (90, 96, 96), (150, 225, 255))
    sheet.box(1.05, height - 0.32, 0.65, 0.1, (215, 228, 232), (200, 240, 255))


def paint_sign(rng: np.random.Generator, sheet: Sheet) -> None:
    """Paint a traffic sign, a street name or a notice on a pole."""
    middle, height = sheet.width_m / 2, sheet.height_m
    sheet.box(middle - 0.04, 0, 0.08, height - 0.2, (120, 124, 124))
    top = height - 0.45
    match rng.integers(4):
        case 0:
            sheet.disc(middle, top, 0.4, (40, 40, 205))
            sheet.disc(middle, top, 0.29, (240, 240, 240))
            limit = f'{rng.integers(2, 9)}0'
            sheet.text(middle - 0.24, top - 0.12, 0.26, limit, (20, 20, 20))
        case 1:
            sheet.polygon(
                [(middle - 0.45, top - 0.35), (middle + 0.45, top - 0.35), (middle, top + 0.42)],
                (40, 40, 205),
            )
            sheet.polygon(
                [(middle - 0.27, top - 0.24), (middle + 0.27, top - 0.24), (middle, top + 0.22)],
                (240, 240, 240),
            )
        case 2:
            sheet.box(middle - 0.4, top - 0.4, 0.8, 0.8, (190, 90, 30))
            sheet.text(middle - 0.22, top - 0.22, 0.45, word(rng, 1, 1), (245, 245, 245))
        case _:
            board = any_colour(rng, (0.4, 0.9), (0.3, 0.7))
            sheet.box(middle - 0.5, top - 0.15, 1.0, 0.4, board)
            sheet.text(middle - 0.42, top - 0.03, 0.16, word(rng, 4, 6), (245, 245, 245))
    if rng.uniform() < 0.4:
        sheet.box(middle - 0.3, top - 0.85, 0.6, 0.3, (235, 235, 235))


def paint_hanging_sign(rng: np.random.Generator, sheet: Sheet) -> None:
    """Paint a shop sign that hangs out over the pavement."""
    board = any_colour(rng, (0.3, 1.0), (0.3, 0.95))
    ink: Colour = (245, 245, 245) if sum(board) < 400 else (25, 25, 25)
    width, height = sheet.width_m, sheet.height_m
    sheet.box(0, 0, width, height, shade_of(board, 0.6), shade_of(board, 0.5))
    sheet.box(0.05, 0.05, width - 0.1, height - 0.1, board, shade_of(board, 0.8))
    for line in range(max(1, int(height / 0.35))):
        sheet.text(0.1, height - 0.32 - 0.35 * line, 0.22, word(rng, 2, 4), ink)


def paint_car_side(rng: np.random.Generator, sheet: Sheet) -> None:
    """Paint a car from the side, its rear on the left."""
    paint = shade_of(_CARS[rng.integers(len(_CARS))], rng.uniform(0.8, 1.1))
    length, top = sheet.width_m, sheet.height_m
    nose = rng.uniform(0.62, 0.92)
    waist = rng.uniform(0.85, 0.95)
    roof_end, bonnet = nose * length - 0.9, nose * length
    body = [(0.0, 0.28), (length, 0.28), (length, 0.66), (bonnet, waist)]
    sheet.polygon([*body, (roof_end, top - 0.02), (0.0, top - 0.02)], paint)
    sheet.polygon(
        [(0.2, top - 0.12), (roof_end - 0.05, top - 0.12), (bonnet - 0.3, waist), (0.25, waist)],
        _GLASS,
    )
    shine = [(0.40 * length, waist), (0.46 * length, waist)]
    shine += [(0.52 * length, top - 0.12), (0.46 * length, top - 0.12)]
    sheet.polygon(shine, shade_of(_GLASS, 1.7))
    sheet.box(0.1, waist - 0.06, bonnet - 0.2, 0.04, shade_of(paint, 1.25))
    sheet.box(0.0, 0.37, length, 0.1, shade_of(paint, 0.78))
    for pillar in (0.36, 0.58):
        sheet.box(pillar * length, waist - 0.02, 0.09, top - waist - 0.06, paint)
        sheet.box(pillar * length, 0.35, 0.03, waist - 0.35, shade_of(paint, 0.6))
        sheet.box(pillar * length - 0.3, waist - 0.16, 0.2, 0.05, shade_of(paint, 0.5))
    sheet.box(0.0, 0.25, length, 0.12, shade_of(paint, 0.45))
    sheet.box(0.0, 0.6, 0.18, 0.2, (40, 40, 190))
    sheet.box(length - 0.2, 0.55, 0.2, 0.16, (225, 232, 235))
    for wheel in (0.19, 0.8):
        sheet.disc(wheel * length, 0.33, 0.39, shade_of(paint, 0.3))
        sheet.disc(wheel * length, 0.32, 0.32, _RUBBER)
        sheet.disc(wheel * length, 0.32, 0.2, (150, 154, 156))


def paint_car_end(rng: np.random.Generator, sheet: Sheet) -> None:
    """Paint a car from behind; also used for the front."""
    paint = shade_of(_CARS[rng.integers(len(_CARS))], rng.uniform(0.8, 1.1))
    width, top = sheet.width_m, sheet.height_m
    sheet.box(0.1, 0.0, 0.24, 0.4, _RUBBER)
    sheet.box(width - 0.34, 0.0, 0.24, 0.4, _RUBBER)
    sheet.polygon([(0.0, 0.25), (width, 0.25), (width, top - 0.02), (0.0, top - 0.02)], paint)
    sheet.polygon(
        [(0.16, 0.92), (width - 0.16, 0.92), (width - 0.2, top - 0.12), (0.2, top - 0.12)], _GLASS
    )
    sheet.polygon(
        [(0.4, 0.92), (0.7, 0.92), (0.95, top - 0.12), (0.65, top - 0.12)], shade_of(_GLASS, 1.6)
    )
    sheet.box(0.0, 0.25, width, 0.2, shade_of(paint, 0.5))
    sheet.box(0.04, 0.84, width - 0.08, 0.05, shade_of(paint, 1.2))
    for lamp in (0.02, width - 0.3):
        sheet.box(lamp, 0.62, 0.28, 0.2, (40, 40, 190))
    sheet.box(width / 2 - 0.28, 0.5, 0.56, 0.15, (225, 230, 232))
    sheet.text(width / 2 - 0.25, 0.53, 0.09, word(rng, 3, 5), (20, 20, 20))


def paint_fence(rng: np.random.Generator, sheet: Sheet) -> None:
    """Paint a hedge, a garden wall or a fence."""
    width, height = sheet.width_m, sheet.height_m
    match rng.integers(3):
        case 0:
            leaf = (rng.uniform(35, 60), rng.uniform(85, 130), rng.uniform(50, 90))
            sheet.box(0, 0, width, height - 0.15, shade_of(leaf, 0.6))
            for _ in range(int(width * 60)):
                at = rng.uniform(0, width), rng.uniform(0, height - 0.12)
                tone = shade_of(leaf, rng.uniform(0.5, 1.2))
                sheet.disc(*at, rng.uniform(0.05, 0.13), tone)
        case 1:
            stone = shade_of((120, 134, 146), rng.uniform(0.6, 1.2))
            sheet.box(0, 0, width, height, shade_of(stone, 0.6))
            for course in np.arange(0, height, 0.24):
                left = -rng.uniform(0, 0.5)
                while left < width:
                    size = rng.uniform(0.25, 0.7)
                    tone = shade_of(stone, rng.uniform(0.75, 1.2))
                    sheet.box(left, course, size - 0.03, 0.21, tone)
                    left += size
        case _:
            board = any_colour(rng, (0.1, 0.5), (0.3, 0.9))
            sheet.box(0, height * 0.7, width, 0.1, shade_of(board, 0.7))
            sheet.box(0, height * 0.25, width, 0.1, shade_of(board, 0.7))
            for left in np.arange(0, width, rng.uniform(0.14, 0.3)):
                tone = shade_of(board, rng.uniform(0.8, 1.1))
                sheet.box(left, 0.03, 0.1, height * rng.uniform(0.9, 1.0), tone)


def paint_bin(rng: np.random.Generator, sheet: Sheet) -> None:
    """Paint a bin, a post box or a switch cabinet."""
    paint = any_colour(rng, (0.2, 0.9), (0.2, 0.8))
    width, height = sheet.width_m, sheet.height_m
    sheet.box(0, 0, width, height, shade_of(paint, 0.7))
    sheet.box(0.03, 0.1, width - 0.06, height - 0.2, paint)
    sheet.box(0.08, height * 0.7, width - 0.16, 0.08, (30, 30, 30))
    sheet.text(0.08, height * 0.4, 0.14, word(rng, 1, 3), (240, 240, 240))
