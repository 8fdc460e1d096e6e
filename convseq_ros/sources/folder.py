# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A folder of pictures as a stream of frames."""

from collections.abc import Iterator
from pathlib import Path
import re

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Frame
from convseq_ros.errors import ImageError, SourceError
from convseq_ros.sources.images import gray_and_color, read_picture
from convseq_ros.sources.raw_message import MAX_STAMP_NS

IMAGE_SUFFIXES = frozenset(
    {'.jpg', '.jpeg', '.png', '.bmp', '.tif', '.tiff', '.ppm', '.pgm', '.webp'}
)
FRAME_INTERVAL_NS = 100_000_000


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Return a sort key that puts img2 before img10; equal numbers are sorted by spelling."""
    parts = re.findall(r'[0-9]+|[^0-9]+', path.name.casefold())
    keys = [(int(part), '') if part[0] in '0123456789' else (-1, part) for part in parts]
    return keys, path.name


def pictures_in(path: Path) -> list[Path]:
    """Return the pictures of a folder, img2 before img10, hidden ones left out; or SourceError."""
    try:
        named = [file for file in path.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES]
        pictures = [file for file in named if not file.name.startswith('.') and file.is_file()]
    except OSError as error:
        raise SourceError(
            f'{path}: {error.strerror}; check the path and its permissions'
        ) from None
    return sorted(pictures, key=natural_key)


def unreadable(picture: Path, error: ImageError | OSError) -> str:
    """Return in one line why a picture cannot be used, and what to do."""
    reason = error.strerror if isinstance(error, OSError) else error
    return f'{picture}: not a readable picture ({reason}); restore it or remove it'


class ImageFolder:
    """
    The pictures of a folder, in natural order of their names.

    The frame of a picture that cannot be read has a `problem` and no image.
    Frames are stamped by their names if every name is a whole number of 16 digits or more
    (nanoseconds, as EuRoC and TUM-VI name them), else 0.1 s apart (0 would be no stamp to ROS).
    """

    def __init__(self, path: Path, reading: ReadingConfig = ReadingConfig()) -> None:
        if not path.is_dir():
            raise SourceError(f'{path}: no such folder; give a folder of pictures')
        self._pictures = pictures_in(path)
        if not self._pictures:
            suffixes = ' '.join(sorted(suffix[1:] for suffix in IMAGE_SUFFIXES))
            raise SourceError(
                f'{path}: no pictures and no recording in this folder; expected {suffixes}, '
                'or a .mcap, .db3 or .bag file'
            )
        self._reading = reading
        self.name = path.resolve().name
        self.topic = ''
        self.warnings: list[str] = []

    def __len__(self) -> int:
        return len(self._pictures)

    def __iter__(self) -> Iterator[Frame]:
        for stamp_ns, picture in zip(_stamps_ns(self._pictures), self._pictures, strict=True):
            try:
                pixels = read_picture(picture, self._reading)
            except (ImageError, OSError) as error:
                problem = unreadable(picture, error)
                yield Frame(stamp_ns, None, picture.name, problem=problem)
                continue
            gray, color = gray_and_color(pixels, self._reading)
            yield Frame(stamp_ns, gray, picture.name, color=color)


def _stamps_ns(pictures: list[Path]) -> list[int]:
    names = [picture.stem for picture in pictures]
    if all(re.fullmatch('[0-9]{16,}', name) and int(name) <= MAX_STAMP_NS for name in names):
        return [int(name) for name in names]
    return [(index + 1) * FRAME_INTERVAL_NS for index in range(len(names))]
