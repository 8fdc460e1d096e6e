# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images from messages, folders and recordings, and the nearest one to a stamp."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import are_proportional
from convseq_ros.errors import ImageError, SourceError
from convseq_ros.sources.folder import pictures_in, without_depth
from convseq_ros.sources.images import decoded, picture_bytes, pixels_of
import cv2
import numpy as np
import numpy.typing as npt

Depth = npt.NDArray[np.float32]  # (H, W), metres; 0 or not finite where unknown
DepthAt = Callable[[int, int], Depth | None]  # from a frame's number and its stamp

DEPTH_TYPES = ('sensor_msgs/msg/Image',)
REACH_NS = 20_000_000  # between the stamps of an image and its depth; frames are 33 ms apart
KEPT = 8  # maximum number of depth images that wait for their image
_MM = np.float32(1e-3)
_KINDS = {'16UC1': 'u2', 'mono16': 'u2', '32FC1': 'f4'}


def nearest(stamped: Iterable[tuple[int, Any]], stamp_ns: int) -> Any | None:
    """Return the item with the stamp nearest to a time; None if none is within REACH_NS."""
    best = min(stamped, key=lambda item: abs(item[0] - stamp_ns), default=None)
    return best[1] if best and abs(best[0] - stamp_ns) <= REACH_NS else None


def decode_depth(message: Any, reading: ReadingConfig = ReadingConfig()) -> Depth:
    """Return the depth image of a sensor_msgs/Image, 16UC1 (mm) or 32FC1 (m); or ImageError."""
    kind = _KINDS.get(message.encoding)
    if kind is None:
        raise ImageError(
            f'encoding: {message.encoding!r} is not a depth image; expected {", ".join(_KINDS)}'
        )
    pixels = pixels_of(message, np.dtype(kind).itemsize, reading)
    typed = np.dtype(('>' if message.is_bigendian else '<') + kind)
    return metres(pixels.view(typed)[..., 0])


def metres(numbers: npt.NDArray[Any]) -> Depth:
    """Return depths in metres, given in metres or in whole millimetres."""
    return numbers.astype(np.float32) * (_MM if numbers.dtype.kind == 'u' else np.float32(1))


def unregistered(depth_m: Depth, shape: tuple[int, ...]) -> str:
    """Return a line if a depth image has other proportions than its image; else nothing."""
    if are_proportional(depth_m.shape, shape):
        return ''
    (height, width), (below, across) = depth_m.shape, shape
    return (
        f'depth images of {width} x {height} px cannot be registered to images of {across} x '
        f'{below} px; take those that are, as of a topic aligned_depth_to_color'
    )


class DepthFolder:
    """Depth images of a folder, 16 bit, millimetres; the first belongs to the first frame."""

    def __init__(self, path: Path, reading: ReadingConfig, warnings: list[str]) -> None:
        pictures = pictures_in(path)
        self._pictures = without_depth(pictures)[1] or pictures
        if not self._pictures:
            raise SourceError(f'{path}: no depth images in this folder; expected PNGs of 16 bits')
        self._reading, self._warnings = reading, warnings

    def __call__(self, index: int, _stamp_ns: int) -> Depth | None:
        """Return the depth image of a frame, by the frame's index; None if there is none."""
        if index >= len(self._pictures):
            return None
        picture = self._pictures[index]
        try:
            return _read(picture, self._reading)
        except (OSError, ImageError) as error:
            self._warnings.append(f'{picture}: {error}; its frame has no depth')
            return None


def _read(picture: Path, reading: ReadingConfig) -> Depth:
    numbers = decoded(picture_bytes(picture, reading), cv2.IMREAD_UNCHANGED, reading)
    if numbers.dtype != np.uint16 or numbers.ndim != 2:
        raise ImageError('not a picture with one channel of 16 bits')
    return metres(numbers)


@dataclass(eq=False)
class DepthTopic:
    """Depth images of messages, by stamp; damaged ones are left out, with a warning."""

    messages: Any  # of a topic, in order; can be iterated again
    reading: ReadingConfig
    warnings: list[str]

    def __post_init__(self) -> None:
        self._coming: Iterator[Any] = iter(())
        self._waiting = deque[tuple[int, Any]](maxlen=KEPT)

    def __call__(self, index: int, stamp_ns: int) -> Depth | None:
        """Return the depth image whose stamp is nearest, within reach; frames come in order."""
        if not index:
            self._coming = iter(self.messages)
            self._waiting.clear()
        while not self._waiting or self._waiting[-1][0] < stamp_ns:
            if (message := next(self._coming, None)) is None:
                break
            self._waiting.append((message.stamp_ns, message))
        message = nearest(self._waiting, stamp_ns)
        try:
            return None if message is None else decode_depth(message.image(), self.reading)
        except ImageError as error:
            if (
                line := f'{self.messages.chosen.name}: {error}; its frame has no depth'
            ) not in self.warnings:
                self.warnings.append(line)
            return None
