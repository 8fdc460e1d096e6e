# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images of a folder or a recording, for the frames of a source."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from convseq_ros.errors import ImageError, SourceError
from convseq_ros.picture_header import declared
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources.depth import decode_depth, Depth, KEPT, metres, nearest
from convseq_ros.sources.folder import pictures_in
from convseq_ros.sources.raw_message import RawMessage
import cv2
import numpy as np

DepthAt = Callable[[int, int], Depth | None]  # from a frame's number and its stamp

DEPTH_TYPES = ('sensor_msgs/msg/Image',)
_PIXEL_BYTES = 8  # at most; larger files belong to more pixels


class DepthFolder:
    """
    Depth images of a folder, 16 bit and in millimetres: the first is the first frame's, and so on.

    SourceError if there is none. One that cannot be read gives its frame no depth.
    """

    def __init__(self, path: Path, reading: ReadingConfig, warnings: list[str]) -> None:
        try:
            self._pictures = pictures_in(path)
        except OSError as error:
            raise SourceError(f'{path}: {error.strerror}; check the path') from None
        if not self._pictures:
            raise SourceError(f'{path}: no depth images in this folder; expected PNGs of 16 bits')
        self._reading, self._warnings = reading, warnings

    def __call__(self, index: int, _stamp_ns: int) -> Depth | None:
        """Return the depth image of a frame's number; None if there is none."""
        if index >= len(self._pictures):
            return None
        picture = self._pictures[index]
        try:
            return _read(picture, self._reading)
        except (OSError, ImageError) as error:
            self._warnings.append(f'{picture}: {error}; its frame has no depth')
            return None


def _read(picture: Path, reading: ReadingConfig) -> Depth:
    reading.refuse_image(picture.stat().st_size // _PIXEL_BYTES, 'a depth image')
    data = picture.read_bytes()
    if (size := declared(data)) is None:
        raise ImageError('no picture that can be read')
    reading.refuse_picture(size, 'a depth image')
    numbers = None
    with suppress(cv2.error):
        numbers = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if numbers is None or numbers.dtype != np.uint16 or numbers.ndim != 2:
        raise ImageError('no picture of one channel of 16 bits')
    return metres(numbers)


class DepthTopic:
    """Depth images of a recording by their stamps; what is damaged is left out, with a warning."""

    def __init__(
        self,
        messages: Callable[[], Iterable[RawMessage]],
        topic: str,
        reading: ReadingConfig,
        warnings: list[str],
    ) -> None:
        self._messages, self._topic, self._reading = messages, topic, reading
        self._warnings = warnings
        self._coming: Iterator[RawMessage] = iter(())
        self._waiting = deque[tuple[int, RawMessage]](maxlen=KEPT)

    def __call__(self, index: int, stamp_ns: int) -> Depth | None:
        """Return the depth image whose stamp is nearest, within reach; frames come in order."""
        if not index:
            self._coming = iter(self._messages())
            self._waiting.clear()
        while not self._waiting or self._waiting[-1][0] < stamp_ns:
            if (message := next(self._coming, None)) is None:
                break
            self._waiting.append((message.stamp_ns, message))
        found = nearest(self._waiting, stamp_ns)
        try:
            return None if found is None else decode_depth(found.decode(), self._reading)
        except ImageError as error:
            if (line := f'{self._topic}: {error}; its frame has no depth') not in self._warnings:
                self._warnings.append(line)
            return None
