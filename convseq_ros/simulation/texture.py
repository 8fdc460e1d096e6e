# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sheets to paint on in metres, random grain, and textures at several resolutions."""

from convseq_ros.simulation.light import Colour, Floats, Image
import cv2
import numpy as np
import numpy.typing as npt

Points = list[tuple[float, float]]


class Texture:
    """A picture, BGRA premultiplied by alpha, with versions shrunk in each direction."""

    def __init__(self, image: Image) -> None:
        self._levels = {(0, 0): image}

    def level(self, across: int, down: int) -> Image:
        """Return the version shrunk by 2**across in width and by 2**down in height."""
        level = self._levels.get((across, down))
        if level is not None:
            return level
        larger = self.level(across - 1, down) if across > down else self.level(across, down - 1)
        height, width = self._levels[0, 0].shape[:2]
        size = (max(1, width >> across), max(1, height >> down))
        smaller: Image = cv2.resize(larger, size, interpolation=cv2.INTER_AREA)
        self._levels[across, down] = smaller
        return smaller


class Sheet:
    """A surface painted in metres, x to the right and z up from the lower left corner."""

    def __init__(
        self, width_m: float, height_m: float, resolution: float, glowing: bool = False
    ) -> None:
        self.width_m, self.height_m, self.resolution = width_m, height_m, resolution
        shape = max(2, round(height_m * resolution)), max(2, round(width_m * resolution))
        self.image: Image = np.zeros((*shape, 4), np.uint8)
        self.glow: Image | None = np.zeros((*shape, 3), np.uint8) if glowing else None

    def _pixels(self, points: Points) -> npt.NDArray[np.int32]:
        fine = 16 * self.resolution
        bottom = 16 * self.image.shape[0] - 8
        return np.array(
            [(round(x * fine - 8), round(bottom - z * fine)) for x, z in points], np.int32
        )

    def polygon(self, points: Points, colour: Colour, shine: Colour | None = None) -> None:
        """Fill a polygon; `shine` is the colour that it emits at night."""
        pixels = self._pixels(points)
        cv2.fillPoly(self.image, [pixels], (*colour, 255), cv2.LINE_AA, 4)
        if self.glow is not None:
            cv2.fillPoly(self.glow, [pixels], shine or (0, 0, 0), cv2.LINE_AA, 4)

    def box(
        self,
        x: float,
        z: float,
        width: float,
        height: float,
        colour: Colour,
        shine: Colour | None = None,
    ) -> None:
        corners = [(x, z), (x + width, z), (x + width, z + height), (x, z + height)]
        self.polygon(corners, colour, shine)

    def line(self, points: Points, width: float, colour: Colour) -> None:
        thickness = max(1, round(width * self.resolution))
        pixels = self._pixels(points)
        cv2.polylines(self.image, [pixels], False, (*colour, 255), thickness, cv2.LINE_AA, 4)

    def disc(self, x: float, z: float, radius: float, colour: Colour) -> None:
        ((column, row),) = self._pixels([(x, z)]).tolist()
        size = round(radius * self.resolution * 16)
        cv2.circle(self.image, (column, row), size, (*colour, 255), -1, cv2.LINE_AA, 4)

    def text(self, x: float, z: float, height: float, words: str, colour: Colour) -> None:
        """Write words with capitals of a height in metres."""
        ((column, row),) = (self._pixels([(x, z)]) // 16).tolist()
        scale = height * self.resolution / 21.0
        pen = cv2.FONT_HERSHEY_DUPLEX, scale
        thickness = max(1, round(scale * 2))
        ink = (*colour, 255.0)
        cv2.putText(self.image, words, (column, row), *pen, ink, thickness, cv2.LINE_AA)
        if self.glow is not None:
            ink = (*shade_of(colour, 0.5), 0.0)
            cv2.putText(self.glow, words, (column, row), *pen, ink, thickness, cv2.LINE_AA)

    def grain(self, rng: np.random.Generator, strength: float) -> None:
        """Add noise at many scales to the picture so far; alpha stays."""
        rough = 1.0 + strength * cloud(rng, self.image.shape[0], self.image.shape[1])
        painted = np.minimum(self.image[..., :3] * rough[..., None], self.image[..., 3:])
        self.image[..., :3] = painted.astype(np.uint8)


def cloud(rng: np.random.Generator, height: int, width: int, finest: int = 2) -> Floats:
    """Return noise (H, W) of about unit strength, with details of `finest` pixels and more."""
    total = np.zeros((height, width), np.float32)
    scale, weight = finest, 0.45
    while scale < 2 * max(height, width) and scale < 200:
        grid = rng.standard_normal((height // scale + 2, width // scale + 2), np.float32)
        total += weight * cv2.resize(grid, (width, height), interpolation=cv2.INTER_LINEAR)
        scale, weight = scale * 3, 0.6
    return total


def shade_of(colour: Colour, factor: float) -> Colour:
    blue, green, red = (min(255.0, channel * factor) for channel in colour)
    return blue, green, red


def any_colour(
    rng: np.random.Generator, saturation: tuple[float, float], value: tuple[float, float]
) -> Colour:
    """Return a random colour, BGR, with saturation and value from ranges in 0..1."""
    hsv = np.array(
        [[[rng.uniform(0, 180), 255 * rng.uniform(*saturation), 255 * rng.uniform(*value)]]],
        np.uint8,
    )
    blue, green, red = cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)[0, 0].tolist()
    return blue, green, red
