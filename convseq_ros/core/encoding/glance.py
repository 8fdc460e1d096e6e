# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small copies of an image: its edges (a glance), and its brightness, which tells the light."""

from convseq_ros.core.types import constants, Doubles, Floats, Gray
import cv2
import numpy as np


@constants
class GRID:
    """The grid; 8 x 4 tells day, evening and night apart."""

    rows: int = 8
    columns: int = 4
    darkest: float = 4.0  # levels; darker pixels count as this bright


def brightness(gray: Gray) -> Doubles:
    """Return the logarithms of brightness (32,) of an image (H, W), on a grid of 8 x 4."""
    size = GRID.columns, GRID.rows
    small = cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.float64)
    return np.log(small.clip(GRID.darkest)).ravel()


Glance = Floats  # (2, 48, 64), normalised to length 1, hence the same in dimmer light

_AREA = cv2.INTER_AREA  # each pixel is the mean of the pixels that it covers


@constants
class GLANCE:
    """Engineering, but for `moved`."""

    width_px: int = 64
    height_px: int = 48
    least_edge: float = 0.3  # smallest RMS of edges, in roots of a grey level, for a glance
    # Twice the largest distance in 262 pairs of images of one scene: with noise, 3 % to 100 % of
    # the light, and shifts of up to 4 pixels.
    moved: float = 0.7


def glance(gray: Gray) -> Glance | None:
    """Return the edges of a small copy of an image (H, W); None if there are hardly any."""
    size = width, height = GLANCE.width_px, GLANCE.height_px
    # Halving is four times as fast as other reductions.
    while min(gray.shape[0] // height, gray.shape[1] // width) >= 8 and not any(
        side % 2 for side in gray.shape
    ):
        gray = cv2.resize(gray, (gray.shape[1] // 2, gray.shape[0] // 2), interpolation=_AREA)
    small = np.sqrt(cv2.resize(gray, size, interpolation=_AREA), dtype=np.float32)
    edges: Glance = np.stack([cv2.Sobel(small, -1, 1, 0), cv2.Sobel(small, -1, 0, 1)])
    length = float(np.linalg.norm(edges))
    if length < GLANCE.least_edge * edges.size**0.5:
        return None
    edges /= length
    return edges


def distance(edges: Glance, other: Glance) -> float:
    """Return the distance of two glances, in [0, 2]."""
    return float(np.linalg.norm(edges - other))
