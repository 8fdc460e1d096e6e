# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A video file as a stream of frames."""

from collections.abc import Iterator
from pathlib import Path

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Frame
from convseq_ros.errors import SourceError
from convseq_ros.sources.images import gray_and_color
import cv2
import numpy as np

VIDEO_SUFFIXES = frozenset({'.mp4', '.avi', '.mkv', '.mov', '.webm', '.m4v', '.mpg', '.mpeg'})


class Video:
    """The frames of a video, stamped by its frame rate from 0 on; or SourceError."""

    pose_frame = ''

    def __init__(self, path: Path, reading: ReadingConfig = ReadingConfig()) -> None:
        if not path.is_file():
            raise SourceError(f'{path}: no such file or folder; check the path')
        self._path, self._reading = path, reading
        self.name = path.name
        self.topic = ''
        self.warnings: list[str] = []
        capture = self._opened()
        width, height = map(capture.get, (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        what = f'{path}: an image of {width:.0f} x {height:.0f} px'
        if line := reading.above('max_image_mpx', width * height / 1e6, what):
            capture.release()
            raise SourceError(line)
        self._count = max(0, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
        rate = capture.get(cv2.CAP_PROP_FPS)
        self._interval_ns = round(1e9 / (rate if rate > 0 else 30.0))
        capture.release()

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Frame]:
        capture = self._opened()
        count = 0
        try:
            while True:
                is_read, image = capture.read()
                if not is_read:
                    break
                gray, color = gray_and_color(np.asarray(image, np.uint8), self._reading)
                source = f'{self.name} {count}'
                yield Frame(count * self._interval_ns, gray, source, color=color)
                count += 1
        finally:
            capture.release()
        if count < self._count:
            warning = (
                f'{self._path}: {count} frames were read, but it announces {self._count}; '
                'it may be damaged'
            )
            if warning not in self.warnings:
                self.warnings.append(warning)

    def _opened(self) -> cv2.VideoCapture:
        capture = cv2.VideoCapture(str(self._path))
        if not capture.isOpened():
            capture.release()
            raise SourceError(
                f'{self._path}: OpenCV cannot read this video; convert it with '
                '`ffmpeg -i VIDEO out.mp4`'
            )
        return capture
