# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the robot sees and where it believes to be: a picture, and a moving one."""

from collections.abc import Sequence
from dataclasses import dataclass
import io
import math
from pathlib import Path

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Pose
from convseq_ros.simulation.drive import Shot
import numpy as np
from PIL import Image, ImageDraw, ImageFont

_PAPER, _INK, _DIM, _TRUE = (15, 23, 32), (232, 238, 244), (86, 102, 117), (78, 168, 255)
_COLOURS = {'lost': (255, 107, 107), 'candidate': (245, 166, 35), 'localised': (74, 222, 128)}
_VIEW = 240, 180  # pixels of an image
_GAP, _LINE = 8, 22  # between things, and of a line of text
_MAP = 300, 2 * _VIEW[1] + _GAP
_SCENE = _VIEW[0] + _MAP[0] + 3 * _GAP, _MAP[1] + 2 * _GAP + _LINE
_STRIP = 60
_BAR_M = 50  # of the scale
# A few hundred kB, for a page.
_SMALLER, _EVERY, _KEPT_COLOURS = 0.75, 2, 64
_FRAME_MS, _LAST_MS = 300, 2500


@dataclass(frozen=True)
class Step:
    """A frame, and what was said after it."""

    stay: int  # number of the start or kidnapping
    shot: Shot
    state: str
    place: int | None  # recognised last; None if lost
    place_pose: Pose | None
    quality: float

    @property
    def error_m(self) -> float:
        """How far the recognised place is from the camera."""
        if self.place_pose is None:
            return math.inf
        return math.dist(self.place_pose.position, self.shot.pose.position)


def draw_animation(path: Path, reference_map: ReferenceMap, steps: Sequence[Step]) -> None:
    """Write a GIF of every second frame."""
    size = tuple(round(length * _SMALLER) for length in _SCENE)
    scenes = [
        _scene(reference_map, steps[: number + 1]).resize(size, Image.Resampling.BOX)
        for number in range(0, len(steps), _EVERY)
    ]
    reduced = [one.quantize(_KEPT_COLOURS, dither=Image.Dither.NONE) for one in scenes]
    times = [_FRAME_MS] * (len(reduced) - 1) + [_LAST_MS]
    reduced[0].save(
        path, save_all=True, append_images=reduced[1:], duration=times, loop=0, optimize=True
    )


def draw_picture(path: Path, reference_map: ReferenceMap, steps: Sequence[Step]) -> None:
    """Write a PNG: the moment of each stay at which it was found, and all states in a strip."""
    stays = sorted({one.stay for one in steps})
    whole = Image.new('RGB', (len(stays) * _SCENE[0], _SCENE[1] + _STRIP), _PAPER)
    for column, stay in enumerate(stays):
        mine = [number for number, one in enumerate(steps) if one.stay == stay]
        lost = next((n for n in mine if steps[n].state != 'localised'), mine[0])
        found = [n for n in mine if n >= lost and steps[n].state == 'localised']
        moment = found[0] if found else mine[-1]
        whole.paste(_scene(reference_map, steps[: moment + 1]), (column * _SCENE[0], 0))
    pen, width = ImageDraw.Draw(whole), whole.width - 2 * _GAP
    for number, one in enumerate(steps):
        left, right = (_GAP + width * at / len(steps) for at in (number, number + 1))
        top = _SCENE[1] + (0 if number and steps[number - 1].stay == one.stay else -6)
        pen.rectangle((left, top, right - 2, _SCENE[1] + 24), _COLOURS[one.state])
    pen.text(
        (_GAP, _SCENE[1] + 32),
        'frame by frame: ' + ', '.join(_COLOURS),
        _INK,
        ImageFont.load_default(14),
    )
    whole.save(path, optimize=True)


def _scene(reference_map: ReferenceMap, past: Sequence[Step]) -> Image.Image:
    """Return what is known after the last of some frames."""
    now, scene = past[-1], Image.new('RGB', _SCENE, _PAPER)
    view = Image.fromarray(now.shot.image[:, :, ::-1]).resize(_VIEW)
    scene.paste(view, (_GAP, _GAP))
    if now.place is not None:
        thumbnail = Image.open(io.BytesIO(reference_map.thumbnail(now.place)))
        scene.paste(thumbnail.convert('RGB').resize(_VIEW), (_GAP, 2 * _GAP + _VIEW[1]))
    pen, font = ImageDraw.Draw(scene), ImageFont.load_default(14)
    colour = _COLOURS[now.state]
    box = (_GAP, 2 * _GAP + _VIEW[1], _GAP + _VIEW[0], 2 * _GAP + 2 * _VIEW[1])
    pen.rectangle(box, outline=colour if now.place is not None else _DIM, width=2)
    if now.place is None:
        pen.text((_GAP + 60, 2 * _GAP + 1.45 * _VIEW[1]), 'no place yet', _DIM, font)
    _draw_map(pen, reference_map, past)
    told = now.state + (f', place {now.place}, {now.error_m:.1f} m off' if now.place else '')
    pen.text((_GAP, _SCENE[1] - _LINE), told, colour, font)
    name = 'switched on at night' if not now.stay else f'carried away: {now.stay}'
    pen.text((2 * _GAP + _VIEW[0], _SCENE[1] - _LINE), name, _INK, font)
    return scene


def _draw_map(pen: ImageDraw.ImageDraw, reference_map: ReferenceMap, past: Sequence[Step]) -> None:
    """Draw the mapped way, where the robot really is, and where it believes to be."""
    now = past[-1]
    way = np.array([place.pose.position[:2] for place in reference_map.places if place.pose])
    low, span = way.min(axis=0), np.ptp(way, axis=0)
    scale = min((size - 40) / extent for size, extent in zip(_MAP, span, strict=True))

    def at(x: float, y: float) -> tuple[float, float]:
        left = 2 * _GAP + _VIEW[0] + 20 + (x - low[0]) * scale
        return left, _GAP + _MAP[1] - 20 - (y - low[1]) * scale

    pen.line([at(*one) for one in way], _DIM, 2)
    left, top = 2 * _GAP + _VIEW[0] + 50, _GAP + 50
    pen.line((left, top, left + _BAR_M * scale, top), _DIM, 2)
    pen.text((left, top + 4), f'{_BAR_M} m', _DIM, ImageFont.load_default(14))
    trail = [at(*one.shot.pose.position[:2]) for one in past if one.stay == now.stay]
    if len(trail) > 1:
        pen.line(trail, _TRUE, 4)
    _dot(pen, trail[-1], 5, _TRUE)
    if now.place_pose is not None and now.place is not None:
        here = at(*now.place_pose.position[:2])
        left, top = here[0] - 10, here[1] - 10
        pen.ellipse((left, top, left + 20, top + 20), outline=_COLOURS[now.state], width=3)


def _dot(
    pen: ImageDraw.ImageDraw, at: tuple[float, float], radius: int, colour: tuple[int, int, int]
) -> None:
    x, y = at
    pen.ellipse((x - radius, y - radius, x + radius, y + radius), colour)
