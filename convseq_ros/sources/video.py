# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A video file as a stream of frames."""

from collections.abc import Iterator
from pathlib import Path

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Frame
from convseq_ros.errors import SourceError
from convseq_ros.sources.images import gray_of
from convseq_ros.sources.raw_message import MAX_STAMP_NS
from convseq_ros.sources.source import Lines
import cv2
import numpy as np

VIDEO_SUFFIXES = frozenset({'.mp4', '.avi', '.mkv', '.mov', '.webm', '.m4v', '.mpg', '.mpeg'})


_MAX_RATE_HZ = 1000.0  # a video without a frame rate shows the rate of its clock: 1000 or more
_USUAL_RATE_HZ = 30.0


class Video:
    """
    The frames of a video, stamped by their own times from 0 on; or SourceError.

    Frames without times are stamped by the frame rate, or 1/30 s apart if there is none.
    """

    def __init__(self, path: Path, reading: ReadingConfig = ReadingConfig()) -> None:
        if not path.is_file():
            raise SourceError(f'{path}: no such file or folder; check the path')
        self._path, self._reading = path, reading
        self.name = path.name
        self.topic = ''
        self.warnings = Lines()
        capture = self._opened()
        width, height = map(capture.get, (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        what = f'{path}: an image of {width:.0f} x {height:.0f} px'
        reading.refuse_above('max_image_mpx', width * height / 1e6, what)
        rate_hz = capture.get(cv2.CAP_PROP_FPS)
        has_rate = 0 < rate_hz < _MAX_RATE_HZ
        self._interval_ns = round(1e9 / (rate_hz if has_rate else _USUAL_RATE_HZ))
        announced = capture.get(cv2.CAP_PROP_FRAME_COUNT)
        # Without a rate, OpenCV announces a count that it computed from the clock's rate.
        self._count = int(announced) if has_rate and announced >= 1 else 0
        capture.release()

    def __len__(self) -> int:
        self._count = self._count or self._counted()
        return self._count

    def __iter__(self) -> Iterator[Frame]:
        capture = self._opened()
        count, stamp_ns = 0, -self._interval_ns
        try:
            while True:
                is_read, image = capture.read()
                if not is_read:
                    break
                gray = gray_of(np.asarray(image, np.uint8))
                own_ns = _nanoseconds(capture.get(cv2.CAP_PROP_POS_MSEC))
                stamp_ns = own_ns if own_ns > stamp_ns else stamp_ns + self._interval_ns
                yield Frame(stamp_ns, gray, f'{self.name} {count}')
                count += 1
        finally:
            capture.release()
        if count < self._count:
            self.warnings.add(
                f'{self._path}: {count} frames were read, but its header says {self._count}; '
                'it may be damaged'
            )

    def _counted(self) -> int:
        capture, count = self._opened(), 0
        while capture.grab():
            count += 1
        capture.release()
        return count

    def _opened(self) -> cv2.VideoCapture:
        capture = cv2.VideoCapture(str(self._path))
        if not capture.isOpened():
            capture.release()
            raise SourceError(
                f'{self._path}: OpenCV cannot read this video; convert it with '
                '`ffmpeg -i VIDEO out.mp4`'
            )
        return capture


def _nanoseconds(time_ms: float) -> int:
    """Return a time in whole microseconds, as nanoseconds; 0 if it is not a time."""
    return round(time_ms * 1e3) * 1000 if 0 <= time_ms < MAX_STAMP_NS / 1e6 else 0
