# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the robot sees and where it believes to be: a picture, and a moving one."""

from collections.abc import Sequence
from dataclasses import dataclass
import io
import math
from pathlib import Path
from typing import Any

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Pose
from convseq_ros.simulation.drive import Shot
import matplotlib

matplotlib.use('Agg')
from matplotlib import pyplot as plt
from matplotlib.animation import FuncAnimation, PillowWriter
import numpy as np
from PIL import Image

COLOURS = {'lost': '#d62728', 'candidate': '#f5a623', 'localised': '#2ca02c'}
_SCENE_INCHES = 5.6, 3.6
_EVERY, _FRAMES_A_SECOND = 2, 3  # of the animation


@dataclass(frozen=True)
class Step:
    """A frame, and what was said after it."""

    stay: int  # number of the start or kidnapping
    shot: Shot
    state: str
    place: int | None  # recognised last; None if lost
    place_pose: Pose | None

    @property
    def error_m(self) -> float:
        """How far the recognised place is from the camera."""
        if self.place_pose is None:
            return math.inf
        return math.dist(self.place_pose.position, self.shot.pose.position)


def draw_animation(path: Path, reference_map: ReferenceMap, steps: Sequence[Step]) -> None:
    """Write a GIF of every second frame."""
    figure = plt.figure(figsize=_SCENE_INCHES)

    def update(number: int) -> None:
        figure.clear()
        _scene(figure, reference_map, steps[: number + 1])

    frames = range(0, len(steps), _EVERY)
    animation = FuncAnimation(figure, update, frames, init_func=lambda: None)
    animation.save(path, PillowWriter(_FRAMES_A_SECOND), dpi=75)
    plt.close(figure)


def draw_picture(path: Path, reference_map: ReferenceMap, steps: Sequence[Step]) -> None:
    """Write a PNG: the moment of each stay at which it was found, and all states in a strip."""
    stays = sorted({one.stay for one in steps})
    width, height = _SCENE_INCHES
    figure = plt.figure(figsize=(width * len(stays), height + 0.6))
    scenes, strip = figure.subfigures(2, 1, height_ratios=(height, 0.6))
    for own, stay in zip(scenes.subfigures(1, len(stays), squeeze=False)[0], stays, strict=True):
        mine = [number for number, one in enumerate(steps) if one.stay == stay]
        lost = next((n for n in mine if steps[n].state != 'localised'), mine[0])
        found = [n for n in mine if n >= lost and steps[n].state == 'localised']
        _scene(own, reference_map, steps[: (found[0] if found else mine[-1]) + 1])
    axes = strip.add_axes((0.02, 0.5, 0.96, 0.4), frameon=False, xticks=[], yticks=[])
    axes.bar(range(len(steps)), 1, 0.9, color=[COLOURS[one.state] for one in steps])
    axes.set_xlabel(f'frame by frame: {", ".join(COLOURS)} (red, orange, green)')
    figure.savefig(path, dpi=100)
    plt.close(figure)


def _scene(figure: Any, reference_map: ReferenceMap, past: Sequence[Step]) -> None:
    """Draw what is known after the last of some frames: both images, and the map."""
    now = past[-1]
    colour = COLOURS[now.state]
    images = [now.shot.image[:, :, ::-1]]
    if now.place is not None:
        images.append(Image.open(io.BytesIO(reference_map.thumbnail(now.place))).convert('RGB'))
    for number, image in enumerate(images):
        axes = figure.add_axes((0.02, 0.52 - 0.46 * number, 0.42, 0.42), xticks=[], yticks=[])
        axes.imshow(image, aspect='auto')
    axes = figure.add_axes((0.48, 0.06, 0.5, 0.88), aspect='equal', xticks=[], yticks=[])
    way = np.array([place.pose.position[:2] for place in reference_map.places if place.pose])
    trail = np.array([one.shot.pose.position[:2] for one in past if one.stay == now.stay])
    axes.plot(*way.T, color='lightgrey', linewidth=2)
    axes.plot(*trail.T, color='tab:blue', linewidth=3)
    axes.plot(*trail[-1], 'o', color='tab:blue')
    if now.place_pose is not None:
        axes.plot(*now.place_pose.position[:2], 'o', color=colour, markersize=14, fillstyle='none')
    name = 'switched on at night' if not now.stay else f'carried away: {now.stay}'
    told = f', place {now.place}, {now.error_m:.1f} m off' if now.place_pose else ''
    axes.set_title(f'{name}: {now.state}{told}', fontsize=9, color=colour)
