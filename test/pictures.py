# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grey pictures of places, each unlike all others, and folders of them."""

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np


def picture(place: int) -> np.ndarray:
    """Return what a place looks like, (60, 80)."""
    noise = np.random.default_rng(place).integers(0, 256, (60, 80), np.uint8)
    return cv2.GaussianBlur(noise, (5, 5), 1.0)


def scene(place: int, seed: int = 0, size: tuple[int, int] = (160, 120)) -> np.ndarray:
    """Return what a place looks like, coarse and in any size, with noise by a seed."""
    width, height = size
    coarse = np.random.default_rng(place).random((20, 20)).astype(np.float32)
    noise = np.random.default_rng([place, seed]).random((height, width))
    return ((cv2.resize(coarse, size) + noise / 2) * 150).astype(np.uint8)


def corners(number: int, size: tuple[int, int] = (320, 240)) -> np.ndarray:
    """Return a picture of any size with corners everywhere, unlike those of other numbers."""
    noise = np.random.default_rng(number).integers(0, 256, (size[1] // 8, size[0] // 8), np.uint8)
    return cv2.resize(noise, size, interpolation=cv2.INTER_CUBIC)


def walls(count: int) -> list[np.ndarray]:
    """Return grey pictures (120, 160) that have nothing in common."""
    noise = np.random.default_rng(7).integers(0, 256, (count, 120, 160), np.uint8)
    return [cv2.GaussianBlur(one, (5, 5), 1.0) for one in noise]


def written(folder: Path, pictures: Iterable[np.ndarray]) -> Path:
    """Write pictures into a folder that is made for them, in their order; return the folder."""
    folder.mkdir(parents=True)
    for number, gray in enumerate(pictures):
        cv2.imwrite(str(folder / f'{number:03}.png'), gray)
    return folder
