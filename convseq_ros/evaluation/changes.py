# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated differences between two drives, put into the query: pace and appearance."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from convseq_ros.core.types import Frame
from convseq_ros.errors import ConfigError
from convseq_ros.evaluation.drive import Changed
import cv2
import numpy as np
import numpy.typing as npt

Gray = npt.NDArray[np.uint8]
Picture = Callable[[Gray, float, np.random.Generator], Gray]
_STOPS = 3
_NOISE = 12.0
_LAMPS = 6


@dataclass(frozen=True, slots=True)
class Pace:
    """Which frames of the query are shown, in which order, and whether at an even pace."""

    order: tuple[int, ...]
    restamp: bool


def pace(kind: str, amount: float, count: int) -> Pace:
    """
    Return what becomes of the pace of a drive.

    Parameters
    ----------
    kind : str
        One of `PACES`: `speed` (times as fast as the reference), `drop` (share of the frames
        lost), `stops` (frames that the robot stands still, three times).
    amount : float
        How much.
    count : int
        Frames of the drive.

    """
    return PACES[kind](amount, count)


def picture_change(kind: str, amount: float) -> Changed:
    """
    Return what becomes of each image; the same at every call.

    Parameters
    ----------
    kind : str
        One of `PICTURES`: `darken` (share of the light lost, with noise and lamps), `fade` (share
        of the contrast lost), `shift` (share of the width), `zoom` (times), `rotate` (degrees),
        `width` (pixels that the image is reduced to).
    amount : float
        How much.

    """

    def changed(frame: Frame, index: int) -> Frame:
        if frame.gray is None:
            return frame
        generator = np.random.default_rng([index, len(kind)])
        return replace(frame, gray=PICTURES[kind](frame.gray, amount, generator))

    return changed


def check_change(kind: str, amount: float) -> None:
    """Raise a ConfigError if there is no such change or so much of it makes no sense."""
    if kind not in _BOUNDS:
        raise ConfigError(f'change {kind!r} is not one of {", ".join(_BOUNDS)}')
    low, high = _BOUNDS[kind]
    if not low <= amount <= high:
        raise ConfigError(f'change {kind}: {amount} is outside {low} .. {high}')


def _speed(factor: float, count: int) -> Pace:
    steps = np.arange(int(np.ceil(count / factor))) * factor
    return Pace(tuple(np.minimum(np.floor(steps + 1e-9), count - 1).astype(int).tolist()), True)


def _drop(share: float, count: int) -> Pace:
    kept = np.random.default_rng(0).random(count) >= share
    kept[0] = True
    return Pace(tuple(np.flatnonzero(kept).tolist()), False)


def _stops(frames: float, count: int) -> Pace:
    at = [count * (stop + 1) // (_STOPS + 1) for stop in range(_STOPS)]
    times = np.ones(count, int)
    times[at] += int(frames)
    return Pace(tuple(np.repeat(np.arange(count), times).tolist()), True)


def _darken(gray: Gray, share: float, generator: np.random.Generator) -> Gray:
    height, width = gray.shape
    light = np.zeros((height, width), np.float32)
    for _ in range(_LAMPS):
        x, y = generator.integers(0, width), generator.integers(0, max(1, height // 2))
        cv2.circle(light, (int(x), int(y)), max(1, width // 60), 255.0, -1)
    glow = cv2.GaussianBlur(light, (0, 0), max(1.0, width / 40)) + light
    noise = generator.normal(0, _NOISE * share, gray.shape)
    return _bytes(gray * (1 - share) + share * glow + noise)


def _fade(gray: Gray, share: float, _: np.random.Generator) -> Gray:
    return _bytes(128 + (gray.astype(np.float32) - 128) * (1 - share))


def _move(gray: Gray, amount: float, _: np.random.Generator, kind: str) -> Gray:
    height, width = gray.shape
    turn, scale = (amount, 1.0) if kind == 'rotate' else (0.0, amount)
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), turn, scale)
    if kind == 'shift':
        matrix = np.array([[1, 0, amount * width], [0, 1, 0]], np.float64)
    moved = cv2.warpAffine(
        gray, matrix, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(moved, np.uint8)


def _width(gray: Gray, width_px: float, _: np.random.Generator) -> Gray:
    width = int(width_px)
    height = max(1, round(gray.shape[0] * width / gray.shape[1]))
    return np.asarray(cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _bytes(values: npt.NDArray[np.float64] | npt.NDArray[np.float32]) -> Gray:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


PACES: Mapping[str, Callable[[float, int], Pace]] = {
    'speed': _speed, 'drop': _drop, 'stops': _stops,
}  # fmt: skip
PICTURES: Mapping[str, Picture] = {
    'darken': _darken,
    'fade': _fade,
    'shift': partial(_move, kind='shift'),
    'zoom': partial(_move, kind='zoom'),
    'rotate': partial(_move, kind='rotate'),
    'width': _width,
}
_BOUNDS: Mapping[str, tuple[float, float]] = {
    'speed': (0.25, 4.0), 'drop': (0.0, 0.95), 'stops': (0, 1000), 'darken': (0.0, 1.0),
    'fade': (0.0, 1.0), 'shift': (-0.9, 0.9), 'zoom': (1.0, 4.0), 'rotate': (-180.0, 180.0),
    'width': (8, 4096),
}  # fmt: skip
