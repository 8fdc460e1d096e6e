# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A folder of pictures as a stream of frames."""

from collections.abc import Callable, Hashable, Iterator
from contextlib import suppress
from datetime import datetime
from pathlib import Path
import re

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Frame
from convseq_ros.errors import ImageError, printable, SourceError
from convseq_ros.sources.images import gray_of, read_picture
from convseq_ros.sources.raw_message import MAX_STAMP_NS
from convseq_ros.sources.source import Lines
from convseq_ros.sources.topic_rank import shows_no_picture

IMAGE_SUFFIXES = frozenset(
    {'.jpg', '.jpeg', '.png', '.bmp', '.tif', '.tiff', '.ppm', '.pgm', '.webp'}
)
FRAME_INTERVAL_NS = 100_000_000
_DIGITS = 19  # of a time since 1970 in nanoseconds, from 2001 to 2262
_TIME = re.compile(r'(?<![0-9.])([1-9][0-9]{9})(?:\.([0-9]{1,9})|([0-9]{3}|[0-9]{6}|[0-9]{9}))$')
# Year to second, with or without one sign between, and parts of a second.
_DATE = re.compile(
    r'(?<![0-9])((?:19|20)[0-9]{2})([-_.]?)([01][0-9])\2([0-3][0-9])[-_T ]?'
    r'([0-2][0-9])([-_.:]?)([0-5][0-9])\6([0-5][0-9])(?:[-_.]?([0-9]{3}|[0-9]{6}))?$'
)
_SECOND_NS = 1_000_000_000
_SIDE = re.compile(r'(?<![a-z])(?:left|right|cent(?:er|re))(?![a-z])', re.IGNORECASE)
_SLOWEST_HZ, _FASTEST_HZ = 1e-3, 1e3
_DEEPEST, _MOST_SEARCHED, _MOST_NAMED = 3, 200, 4  # of folders in a folder


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Return a sort key that puts img2 before img10; equal numbers are sorted by spelling."""
    parts = re.findall(r'[0-9]+|[^0-9]+', path.name.casefold())
    keys = [(int(part), '') if part[0] in '0123456789' else (-1, part) for part in parts]
    return keys, path.name


def pictures_in(path: Path) -> list[Path]:
    """Return the pictures of a folder, img2 before img10, hidden ones left out; or SourceError."""
    try:
        named = [file for file in path.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES]
        shown = [file for file in named if not file.name.startswith('.')]
        # A link to nothing is a picture that cannot be read; frames after it keep their numbers.
        pictures = [file for file in shown if file.is_file() or not file.exists()]
    except OSError as error:
        raise SourceError(
            f'{path}: {error.strerror}; check the path and its permissions'
        ) from None
    return sorted(pictures, key=natural_key)


def unreadable(picture: Path, error: ImageError | OSError) -> str:
    """Return in one line why a picture cannot be used, and what to do."""
    reason = error.strerror if isinstance(error, OSError) else error
    return f'{printable(str(picture))}: not a readable picture ({reason}); restore it or remove it'


class ImageFolder:
    """
    The pictures of a folder, in natural order of their names.

    The frame of a picture that cannot be read has a `problem` and no image.
    With a rate in hertz, frames are that far apart. Otherwise they are stamped by their names, and
    sorted by them, if `stamp_in` finds a time in every name; else they are 0.1 s apart (0 would be
    no stamp to ROS). Images of depth or labels, and of all cameras but one, are left out; a line
    in `warnings` says so.
    """

    def __init__(
        self, path: Path, reading: ReadingConfig = ReadingConfig(), rate_hz: float | None = None
    ) -> None:
        self._pictures = pictures_in(path)
        if not self._pictures:
            suffixes = ' '.join(sorted(suffix[1:] for suffix in IMAGE_SUFFIXES))
            expected = f'{suffixes}, or a .mcap, .db3 or .bag file'
            raise SourceError(
                f'{path}: no pictures and no recording in this folder; '
                + (_which_folder(path) or f'expected {expected}')
            )
        self._reading = reading
        self.name = printable(path.resolve().name)
        self.topic = ''
        self.warnings = Lines()
        self._keep_one_camera(path)
        self.stamps_ns = self._stamps(path, rate_hz)

    def __len__(self) -> int:
        return len(self._pictures)

    def __iter__(self) -> Iterator[Frame]:
        for stamp_ns, picture in zip(self.stamps_ns, self._pictures, strict=True):
            try:
                pixels = read_picture(picture, self._reading)
            except (ImageError, OSError) as error:
                problem = unreadable(picture, error)
                yield Frame(stamp_ns, None, printable(picture.name), problem=problem)
                continue
            yield Frame(stamp_ns, gray_of(pixels), printable(picture.name))

    def _keep_one_camera(self, path: Path) -> None:
        """Leave out what is no picture, and the pictures of all cameras but the first."""
        others = [one for one in self._pictures if shows_no_picture(one.stem)]
        if 0 < len(others) < len(self._pictures):
            self._leave_out(path, others, 'show depth, labels or the like')
        self._leave_out(
            path,
            _repeated(self._pictures, lambda picture: _SIDE.sub('', picture.stem)),
            'are of another camera; give each camera a folder of its own',
        )

    def _leave_out(self, path: Path, others: list[Path], why: str) -> None:
        self._warn(path, others, why)
        known = set(others)
        self._pictures = [one for one in self._pictures if one not in known]

    def _warn(self, path: Path, others: list[Path], why: str) -> None:
        if others:
            self.warnings.append(
                f'{path}: {len(others)} of {len(self._pictures)} pictures, such as '
                f'{printable(others[0].name)}, are left out: they {why}'
            )

    def _stamps(self, path: Path, rate_hz: float | None) -> list[int]:
        """Return the frames' stamps in nanoseconds; sort the pictures if they are in the names."""
        if rate_hz is not None:
            if not _SLOWEST_HZ <= rate_hz <= _FASTEST_HZ:
                limits = f'{_SLOWEST_HZ:g} to {_FASTEST_HZ:g}'
                raise SourceError(f'--rate {rate_hz:g}: is out of bounds; give {limits} Hz')
            return self._apart(round(_SECOND_NS / rate_hz))
        found = {picture: stamp_in(picture) for picture in self._pictures}
        times = {picture: stamp_ns for picture, stamp_ns in found.items() if stamp_ns is not None}
        if len(times) == len(found):
            same = _repeated(self._pictures, times.__getitem__)
            stamps_ns = [times[picture] for picture in self._pictures]
            is_whole = not any(stamp_ns % _SECOND_NS for stamp_ns in stamps_ns)
            if same and is_whole and stamps_ns == sorted(stamps_ns):
                return self._apart(FRAME_INTERVAL_NS)  # several a second; their order is known
            self._pictures.sort(key=times.__getitem__)
            # They keep their numbers, and the recogniser passes over them.
            why = 'have the time of another; give each camera a folder of its own'
            self._warn(path, same, why)
            return [times[picture] for picture in self._pictures]
        if times:
            other = next(picture.name for picture in self._pictures if picture not in times)
            self.warnings.append(
                f'{path}: {len(found) - len(times)} of {len(found)} names have no time, such as '
                f'{other}; images count as 0.1 s apart: rename or remove those, or give --rate'
            )
        return self._apart(FRAME_INTERVAL_NS)

    def _apart(self, interval_ns: int) -> list[int]:
        return [(index + 1) * interval_ns for index in range(len(self._pictures))]


def _repeated(pictures: list[Path], key: Callable[[Path], Hashable]) -> list[Path]:
    """Return the pictures whose key an earlier one has."""
    first = {key(picture): picture for picture in reversed(pictures)}
    return [picture for picture in pictures if first[key(picture)] is not picture]


def stamp_in(picture: Path) -> int | None:
    """
    Return the time since 1970 in a picture's name, in nanoseconds; None if there is none.

    It ends the name: seconds with a point (TUM), or 13, 16 or 19 digits, which are milliseconds,
    microseconds (RobotCar) or nanoseconds (EuRoC, TUM-VI); or a date and a time to the second or
    finer, which count as UTC: 2022_02_09_16_15_53_331, 20220209_161553.
    """
    if date := _DATE.search(picture.stem):
        year, month, day, hour, minute, second, part = date.group(1, 3, 4, 5, 7, 8, 9)
        with suppress(ValueError):
            at = datetime.fromisoformat(f'{year}{month}{day}T{hour}{minute}{second}Z')
            return int(at.timestamp()) * _SECOND_NS + int((part or '').ljust(9, '0'))
    found = _TIME.search(picture.stem)
    if not found:
        return None
    digits = ''.join(group or '' for group in found.groups())
    stamp_ns = int(digits.ljust(_DIGITS, '0'))
    return stamp_ns if stamp_ns <= MAX_STAMP_NS else None


def _which_folder(path: Path) -> str:
    """Return which folders in a folder hold pictures, as far as three deep; '' if none does."""
    found: list[str] = []
    folders = [path]
    for _ in range(_DEEPEST):
        inner: list[Path] = []
        for folder in folders:
            with suppress(OSError):
                inner += sorted(filter(Path.is_dir, folder.iterdir()), key=natural_key)
        folders = inner[:_MOST_SEARCHED]
        for folder in folders:
            with suppress(SourceError):
                if count := len(pictures_in(folder)):
                    found.append(f'{folder} ({count})')
    more = f' and {len(found) - _MOST_NAMED} more' if len(found) > _MOST_NAMED else ''
    names = ', '.join(found[:_MOST_NAMED])
    return f'give a folder in it: {names}{more}' if found else ''
