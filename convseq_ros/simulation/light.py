# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Day, overcast, evening and night: the effect of light on the colours of the street."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Colour = tuple[float, float, float]

LAMP_HEIGHT_M = 5.8
LAMP_RADIUS_M = 4.5


@dataclass(frozen=True, slots=True)
class Light:
    """One kind of light; colours are BGR in 0..255, gains of 1 change nothing."""

    zenith: Colour  # of the sky
    horizon: Colour  # of the sky; distant objects fade to it
    left: float  # gains of the facades on either side, and of the road
    right: float
    ground: float
    tint: Colour  # gains: the colour of the light
    visibility_m: float  # distance at which 37 % of the contrast is left
    noise: float  # standard deviation of the camera's noise, grey levels
    lamps: float = 0.0  # strength of the street lamps; 0 also leaves all windows dark


LIGHTS = {
    'day': Light((222, 168, 112), (238, 226, 212), 1.10, 0.78, 1.0, (0.96, 1.0, 1.03), 170.0, 1.5),
    'overcast': Light(
        (196, 190, 184), (226, 223, 220), 0.86, 0.86, 0.88, (1.03, 1.0, 0.97), 110.0, 2.0
    ),
    'evening': Light(
        (170, 112, 96), (128, 178, 238), 0.52, 0.98, 0.72, (0.74, 0.92, 1.10), 140.0, 3.0
    ),
    'night': Light(
        (54, 32, 22), (66, 54, 50), 0.21, 0.21, 0.19, (1.20, 1.0, 0.88), 170.0, 5.0, 3.4
    ),
}
_LAMP_COLOUR: Colour = (0.60, 0.88, 1.10)


def illuminate(
    image: Image,
    glow: Image | None,
    light: Light,
    gain: float,
    points: tuple[Floats, Floats, Floats],
    lamps: Sequence[tuple[float, float]],
) -> Image:
    """
    Return a lit texture (H, W, 4), BGRA premultiplied by alpha.

    `image` has the colours in neutral light, `glow` (H, W, 3) the emitted light when lamps are on.
    `gain` is the share of the incident light. `points` are the x, y and z of the texels in metres,
    which broadcast to (H, W). `lamps` are the x, y of the lamps near by.
    """
    tint = np.array(light.tint, np.float32) * np.float32(gain)
    if not light.lamps:
        gains = np.append(tint, np.float32(1.0))
        table = np.clip(np.arange(256)[None, :, None] * gains, 0, 255).astype(np.uint8)
        alpha = cv2.cvtColor(image[..., 3], cv2.COLOR_GRAY2BGRA)
        lit: Image = cv2.min(cv2.LUT(image, table), alpha)
        return lit
    x, y, z = points
    share = np.zeros(np.broadcast_shapes(x.shape, y.shape, z.shape), np.float32)
    for lamp_x, lamp_y in lamps:
        squared = (x - lamp_x) ** 2 + (y - lamp_y) ** 2 + (z - LAMP_HEIGHT_M) ** 2
        share += light.lamps / (1.0 + squared / LAMP_RADIUS_M**2) ** 1.5
    share /= 1.0 + 0.5 * share
    lamp = np.array(_LAMP_COLOUR, np.float32)
    colour = image[..., :3] * (tint + share[..., None] * lamp)
    if glow is not None:
        colour += glow
    return np.dstack((np.minimum(colour, image[..., 3:]).astype(np.uint8), image[..., 3]))
