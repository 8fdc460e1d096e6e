# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Draw the README's moving picture: a robot goes twice round an office and knows where it was.

Usage: loop_gif.py FOLDER FILE, with the 84 sample images of RTAB-Map (BSD-3) in FOLDER.
"""

from pathlib import Path
import sys

from convseq_ros.config import Config, with_values
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Match
from convseq_ros.sources import open_source
from convseq_ros.sources.folder import pictures_in
import numpy as np
from PIL import Image, ImageDraw, ImageFont

_SECOND_ROUND = 36  # frame from where on to show
_FRAME_MS, _LAST_MS = 400, 2500
_GREY_LEVELS = 28
_FINER = 2  # drawn so many times larger, for smooth lines
_WIDTH, _MARGIN = 320 * _FINER, 8 * _FINER
_HEIGHT = _WIDTH * 3 // 4
_TEXT, _ARCS = 26 * _FINER, 96 * _FINER
_INK, _DIM, _GREEN, _PAPER = (230, 237, 243), (110, 118, 129), (63, 185, 80), (13, 17, 23)


def draw(folder: Path, path: Path) -> None:
    """Recognise the images one after another, in a map that grows, and draw the second round."""
    values = {'mode': 'online', 'keyframe_overlap': 1.0, 'stationary_glance': 0.0}
    config = with_values(Config(), values)
    recognizer = PlaceRecognizer(ReferenceMap(config.encoding, keyframes=config.keyframes), config)
    pictures = pictures_in(folder)
    closures: list[tuple[int, int]] = []
    shown = []
    for number, frame in enumerate(open_source(folder)):
        match = recognizer.process(frame)
        if match.accepted:
            closures.append((number, match.accepted.reference_index))
        if number >= _SECOND_ROUND:
            shown.append(_scene(pictures, match, recognizer, closures))
    sequence = [_reduced(one) for one in shown]
    times = [_FRAME_MS] * (len(sequence) - 1) + [_LAST_MS]
    sequence[0].save(
        path, save_all=True, append_images=sequence[1:], duration=times, loop=0, optimize=True
    )
    print(f'{path}: {len(sequence)} pictures, {path.stat().st_size / 1e6:.2f} MB')


def _scene(
    pictures: list[Path],
    match: Match,
    recognizer: PlaceRecognizer,
    closures: list[tuple[int, int]],
) -> Image.Image:
    size = 2 * _WIDTH + 3 * _MARGIN, 2 * _MARGIN + _HEIGHT + _TEXT + _ARCS
    scene = Image.new('RGB', size, _PAPER)
    pen = ImageDraw.Draw(scene)
    left, right, top = _MARGIN, 2 * _MARGIN + _WIDTH, _MARGIN + _TEXT
    query, accepted = match.query_index, match.accepted
    scene.paste(_photo(pictures[query]), (left, top))
    font = ImageFont.load_default(15 * _FINER)
    pen.text((left, _MARGIN), 'the camera now', _INK, font)
    if accepted:
        reference = accepted.reference_index
        scene.paste(_photo(pictures[reference]), (right, top))
        pen.rectangle((right, top, right + _WIDTH, top + _HEIGHT), None, _GREEN, 3 * _FINER)
        text = f'"I was here {query - reference} images ago"'
        pen.text((right, _MARGIN), text, _GREEN, font)
        found = recognizer.displacements(accepted)
        for row, column, other_row, other_column, _ in found[found[:, 4] == 1][::9]:
            start = left + column * _WIDTH, top + row * _HEIGHT
            end = right + other_column * _WIDTH, top + other_row * _HEIGHT
            pen.line((start, end), _GREEN, 1)
    else:
        pen.rectangle((right, top, right + _WIDTH, top + _HEIGHT), _PAPER, _DIM, _FINER)
        pen.text(
            (right, _MARGIN), f'no answer yet: {match.reason.value.replace("_", " ")}', _DIM, font
        )
    _draw_arcs(pen, size, query, len(pictures), closures)
    return scene


def _draw_arcs(
    pen: ImageDraw.ImageDraw,
    size: tuple[int, int],
    query: int,
    count: int,
    closures: list[tuple[int, int]],
) -> None:
    """Draw every image as a dot on a line, and every closure as an arc over it."""
    base, step = size[1] - 3 * _MARGIN // 2, (size[0] - 4 * _MARGIN) / (count - 1)

    def at(index: int) -> float:
        return 2 * _MARGIN + index * step

    for number, reference in closures:
        high = 2 * (_ARCS - 3 * _MARGIN) * (number - reference) / 48
        box = at(reference), base - high / 2, at(number), base + high / 2
        newest = number == query
        pen.arc(box, 180, 360, _GREEN if newest else (35, 98, 47), _FINER * (3 if newest else 1))
    for index in range(count):
        radius = _FINER * (4 if index == query else 2)
        colour = _GREEN if index == query else _INK if index < query else (48, 54, 61)
        x = at(index)
        pen.ellipse((x - radius, base - radius, x + radius, base + radius), colour)


def _photo(path: Path) -> Image.Image:
    return Image.open(path).convert('L').resize((_WIDTH, _HEIGHT)).convert('RGB')


def _reduced(scene: Image.Image) -> Image.Image:
    """Return a smaller picture of few colours: levels of grey, and of green."""
    small = scene.resize((scene.width // _FINER, scene.height // _FINER), Image.Resampling.LANCZOS)
    palette = Image.new('P', (1, 1))
    greys = [(level, level, level) for level in np.linspace(0, 255, _GREY_LEVELS, dtype=int)]
    shades = np.linspace(_PAPER, _GREEN, 16, dtype=int).tolist()
    colours = [value for colour in (*greys, *shades, _INK, _DIM, _PAPER) for value in colour]
    palette.putpalette([int(value) for value in colours])
    return small.quantize(palette=palette, dither=Image.Dither.NONE)


if __name__ == '__main__':
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
