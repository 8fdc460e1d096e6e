# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A panel: an upright painted rectangle, of which all objects on a street are made."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from convseq_ros.simulation.light import illuminate, Light
from convseq_ros.simulation.texture import Sheet, Texture
import numpy as np

Point = tuple[float, float]

Painter = Callable[[np.random.Generator, Sheet], None]


@dataclass(eq=False)
class Panel:
    """An upright painted rectangle."""

    start: Point  # x, y in metres of the left side of the picture
    end: Point  # x, y in metres of the right side
    bottom: float  # heights, metres
    top: float
    visible_m: float  # distance up to which it is drawn
    facing: bool  # whether it turns about its middle to face the camera, like a tree
    resolution: float  # pixels per metre of the picture
    seed: tuple[int, ...]  # of the picture
    paint: Painter  # paints the picture on a sheet
    gain: float  # share of the incident light
    light: Light  # of the street
    lamps: list[Point]  # nearby street lamps, metres

    @cached_property
    def texture(self) -> Texture:
        """The picture in this panel's light, painted on first use."""
        width = float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))
        sheet = Sheet(width, self.top - self.bottom, self.resolution, self.light.lamps > 0)
        self.paint(np.random.default_rng(self.seed), sheet)
        rows, columns = sheet.image.shape[:2]
        across = np.linspace(0, 1, columns, dtype=np.float32)[None, :]
        down = np.linspace(self.top, self.bottom, rows, dtype=np.float32)[:, None]
        where = (
            self.start[0] + (self.end[0] - self.start[0]) * across,
            self.start[1] + (self.end[1] - self.start[1]) * across,
            down,
        )
        lit = illuminate(sheet.image, sheet.glow, self.light, self.gain, where, self.lamps)
        return Texture(lit)
