# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The images of a drive, and what a function makes of each."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
import hashlib
import json
from pathlib import Path
import time
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Frame
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.cache import Cache, Made
from convseq_ros.evaluation.data_set import Part
from convseq_ros.evaluation.provenance import program
from convseq_ros.sources import open_source
from convseq_ros.sources.folder import pictures_in
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Images:
    """The images of a drive, which can be read repeatedly."""

    part: Part  # location
    reading: ReadingConfig = ReadingConfig()  # size limits
    cache: Cache | None = None  # of what is made of them
    warnings: list[str] = field(default_factory=list, compare=False)  # of the last reading

    @cached_property
    def sha256(self) -> str:
        """Digest of the images (see `content_digest`), or of the settings of drawn images."""
        if self.part.simulated:
            facts = json.dumps(asdict(self.part.simulated), sort_keys=True)
            return hashlib.sha256(facts.encode()).hexdigest()
        try:
            return content_digest(self.part.path)
        except OSError as error:
            raise SourceError(f'{error.filename}: {error.strerror}; restore it') from None

    def __iter__(self) -> Iterator[Frame]:
        part = self.part
        if part.simulated:
            yield from self._in_direction(part.simulated)
            return
        source = open_source(part.path, part.topic, self.reading)
        yield from self._in_direction(source)
        self.warnings[:] = source.warnings

    def once(self, what: object, make: Callable[[], Made]) -> Made:
        """
        Return what is made of the images, if possible from the cache.

        The text `repr(what)` says all that it depends on, but for images and programs.
        """
        if self.cache is None:
            return make()
        key = repr((what, self.part, self.reading, self.sha256, program()))
        return self.cache.once(key, make)

    def _in_direction(self, source: Iterable[Frame]) -> Iterator[Frame]:
        if not self.part.backwards:
            yield from source
            return
        frames = list(source)
        first_ns, step_ns = frames[0].stamp_ns, 0
        if len(frames) > 1:
            step_ns = frames[1].stamp_ns - first_ns
        for index, frame in enumerate(reversed(frames)):
            yield replace(frame, stamp_ns=first_ns + index * step_ns)


def described(
    frames: Iterable[Frame], describe: Callable[[npt.NDArray[np.uint8]], Any]
) -> tuple[list[Any], float]:
    """Return a descriptor per image, None if unreadable, and the median time in ms."""
    rows, durations_ms = [], []
    for frame in frames:
        started = time.perf_counter()
        rows.append(None if frame.gray is None else describe(frame.gray))
        durations_ms.append((time.perf_counter() - started) * 1e3)
    return rows, float(np.median(durations_ms))


def content_digest(path: Path) -> str:
    """
    Return the SHA-256 of the list of images in a folder, or of a single file.

    The list has a line per file, in frame order, as `sha256sum` prints it: the SHA-256 of the
    content, two spaces, the name. A folder without images is listed with all its files.
    """
    images = [path] if path.is_file() else pictures_in(path)
    files = images or sorted(file_path for file_path in path.iterdir() if file_path.is_file())
    lines = hashlib.sha256()
    for file_path in files:
        with file_path.open('rb') as file:
            content = hashlib.file_digest(file, 'sha256').hexdigest()
        lines.update(f'{content}  {file_path.name}\n'.encode())
    return lines.hexdigest()
