# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Online mapping: a map grows from the robot's own past, and is persisted as it grows."""

from contextlib import closing, suppress
import math
import os
from pathlib import Path
from threading import Lock
import time

from convseq_ros.config import Config
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import MapWriter
from convseq_ros.core.types import Descriptor, Frame, Pose, Reason
from convseq_ros.errors import MapError
import numpy as np

_COMMIT_EVERY_NS = 500_000_000  # what a crash may cost; each commit waits for the disk
_PLACES_AT_ONCE = 500  # in a transaction, for 10 MB of memory


class PreloadedMap:
    """A map that does not grow: all of its places may be matched."""

    nothing_usable = Reason.NO_MAP  # said of a frame as long as no place may be matched

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map
        self.reset()

    def reset(self) -> None:
        """Begin a new session: all that is in the map is the past."""
        self.session_start = len(self._map)  # the first place of this session

    def update(self, _stamp_ns: int, _pose: Pose | None) -> int:
        """Return how many places, from the first, may be matched."""
        return len(self._map)

    def add(self, frame: Frame, descriptor: Descriptor) -> None:
        """Add nothing."""


class OnlineMap(PreloadedMap):
    """Adds the frames of this session, and excludes those that are recent from being matched."""

    nothing_usable = Reason.RECENT

    def __init__(self, reference_map: ReferenceMap, config: Config) -> None:
        self._exclusion_ns = round(config.online.exclusion_s * 1e9)
        self._exclusion_m = config.online.exclusion_m
        self._width_px = config.keyframes.thumbnail_width_px
        super().__init__(reference_map)

    def reset(self) -> None:
        super().reset()
        self._usable, self._travelled_m = self.session_start, 0.0
        self._pose: Pose | None = None
        self._passed_m: list[float] = []

    def update(self, stamp_ns: int, pose: Pose | None) -> int:
        """Sum up the way by odometry; return how many places are old enough to be matched."""
        if pose and self._pose:
            self._travelled_m += math.dist(pose.position, self._pose.position)
        self._pose = pose or self._pose
        while self._usable < len(self._map) and self._is_past(self._usable, stamp_ns):
            self._usable += 1
        return self._usable

    def add(self, frame: Frame, descriptor: Descriptor) -> None:
        """Add a frame to the map unless it could not be read."""
        if frame.gray is not None:
            self._map.add_frame(frame, descriptor, self._width_px)
            self._passed_m.append(self._travelled_m)

    def _is_past(self, index: int, stamp_ns: int) -> bool:
        way_m = self._travelled_m - self._passed_m[index - self.session_start]
        is_far = self._pose is None or way_m >= self._exclusion_m
        return is_far and stamp_ns - self._map.places[index].stamp_ns >= self._exclusion_ns


def make_mapping(reference_map: ReferenceMap, config: Config) -> PreloadedMap:
    """Return the map as the mode has it."""
    online = config.online.mode == 'online'
    return OnlineMap(reference_map, config) if online else PreloadedMap(reference_map)


class NoAutosave:
    """Stands in for a map that is in memory alone."""

    committed = 0  # places that are safe in a file

    def save(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


class Autosave(NoAutosave):
    """
    Writes what is added to a map to a file; one thread at a time does so.

    The file is a new one, to which all places are written at once, or the one that the map was
    opened from. What is persisted outlives a crash, and is evicted from memory, so that a map may
    grow all day. MapError if the file cannot be written, or holds another map.
    """

    def __init__(self, path: Path, reference_map: ReferenceMap) -> None:
        _refuse_read_only(path)
        self._path, self._map, self._lock = path, reference_map, Lock()
        self._due_ns, self._has_failed = 0, False
        encoding, keyframes = reference_map.encoding, reference_map.keyframes
        self._writer = MapWriter(path, encoding, keyframes, append=path.exists())
        try:
            self._read_pictures = MapReader(path).pictures
            if self._writer.committed:
                self._refuse_other_map()
            self._file = path.stat().st_ino
            self._write()
        except BaseException:
            self._writer.close()
            raise

    def save(self, now_ns: int | None = None) -> None:
        """
        Write what was added, every half a second by a clock that does not jump, and make it safe.

        MapError, once, if it cannot be written; later calls try again, and say nothing until then.
        """
        now_ns = time.monotonic_ns() if now_ns is None else now_ns
        with self._lock:
            if now_ns < self._due_ns:
                return
            self._due_ns = now_ns + _COMMIT_EVERY_NS
            try:
                self._write()
                self._has_failed = False
            except MapError:
                if not self._has_failed:
                    self._has_failed = True
                    raise

    def close(self) -> None:
        """Make all that was added safe and close the file; MapError if it cannot be written."""
        with self._lock, closing(self._writer):
            self._write()

    def _write(self) -> None:
        end = len(self._map)
        self.committed = self._writer.committed
        while self.committed < end:
            self._refuse_replaced()
            stop = min(end, self.committed + _PLACES_AT_ONCE)
            self._writer.copy(self._map, stop)
            self.committed = stop
            self._map.evict(stop, self._read_pictures)

    def _refuse_other_map(self) -> None:
        last = self._writer.committed - 1
        if last >= len(self._map) or not np.array_equal(
            self._read_pictures([last])[0].packed, self._map.packed(last)
        ):
            raise MapError(
                f'{self._path}: holds another map than the one that grows; open that one first, '
                'or name a new file'
            )

    def _refuse_replaced(self) -> None:
        with suppress(OSError):
            if self._path.stat().st_ino == self._file:
                return
        raise MapError(f'{self._path}: was moved or replaced; what is added is not kept')


def _refuse_read_only(path: Path) -> None:
    """Say at the start what would else go wrong later; SQLite needs the folder for its journal."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise MapError(f'{path}: there is no folder {folder}; make it')
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise MapError(
            f'{path}: cannot be written; make it and its folder writable, or copy it elsewhere'
        )
