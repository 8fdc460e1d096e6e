# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The owner of a map that grows: it appends added places to the file, in the background."""

from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Lock, Thread
import time

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.map.database import is_damage
from convseq_ros.core.map.edit import prune_looks
from convseq_ros.core.map.lock import MapLock
from convseq_ros.core.map.pruning import Pruning
from convseq_ros.core.map.reader import map_id_of
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import MapWriter
from convseq_ros.errors import MapError
from convseq_ros.io.bell import Bell

_COMMIT_EVERY_S = 0.5  # a crash may lose this much; each commit waits for the disk
_PLACES_AT_ONCE = 500  # in a transaction, 10 MB of memory


class MapOwner:
    """The owner of a map that is only in memory, or does not grow."""

    committed = 0  # number of places that are safe in a file
    committed_s: float | None = None  # monotonic time at which the file grew last
    is_failing = False  # whether the last write failed
    removed = 0  # number of places that were removed when the map was closed
    lost = ''  # why the file is not written any more, with the remedy
    _error: MapError | None = None  # raised by the next `save`

    def __init__(self, reference_map: ReferenceMap) -> None:
        self.reference_map, self.found = reference_map, len(reference_map)

    def save(self) -> None:
        """Raise a MapError, once, if the file was given up."""
        error, self._error = self._error, None
        if error:
            raise error

    def flush(self) -> None: ...

    def close(self) -> None: ...

    def give_up(self, why: str) -> None:
        """Leave a file alone that cannot be read any more."""
        self.lost = self.lost or why


class Appender(MapOwner):
    """
    The one owner of a map file that grows; it appends places to it in a background thread.

    A place is safe on disk half a second after it was added. Its picture is then released from
    memory, so that a map can grow all day. If the file is moved or replaced, or another program
    writes to it despite the lock, this is reported once and the map grows in memory; writing
    continues when the file is back. A file that was cut short or overwritten is given up.

    `append` is that of `MapWriter`. A new file without places is deleted at the end, unless
    `keeps_empty`. At the end no place keeps more than `max_looks` stretches; 0 is no limit.
    MapError if another owner has the map, it cannot be written, or `MapWriter` refuses it.
    """

    def __init__(
        self,
        path: Path,
        encoding: EncodingConfig,
        keyframes: KeyframeConfig,
        *,
        append: bool | None = None,
        keeps_empty: bool = True,
        max_looks: int = 0,
    ) -> None:
        self._path, self._keeps_empty, self._max_looks = path, keeps_empty, max_looks
        with ExitStack() as opened:
            opened.enter_context(MapLock(path))
            self._writer = MapWriter(path, encoding, keyframes, append)
            opened.callback(self._writer.close)
            super().__init__(self._writer.reference_map())
            self._file = path.stat().st_ino
            self.committed = self._writer.committed
            self._writer.write_ahead()
            self._left = _size_and_time(path)  # after the last write of ours
            self._opened = opened.pop_all()
        self._writing = Lock()
        self._news, self._end = Bell(), Bell()
        self._thread = Thread(target=self._run, name='appender', daemon=True)
        self._thread.start()

    def save(self) -> None:
        """
        Request a write of the places added; call it after every frame.

        MapError, once, if a write failed. It is repeated until it works, without further errors.
        """
        if self._is_behind(len(self.reference_map)):
            self._news.ring()
        super().save()

    def flush(self) -> None:
        """Write all added places, and return when they are safe on disk; MapError if it fails."""
        with self._writing:
            try:
                self._write()
            except MapError as error:
                self.is_failing = True
                if is_damage(error):
                    self._error = self._overwritten(str(error.__cause__))
                raise
            self.is_failing = False

    def close(self) -> None:
        """Write all added places, and close the file; MapError if it fails."""
        self._end.end()
        self._news.end()
        self._thread.join()
        with self._opened:
            self.flush()
            if self._is_in_place():
                self._writer.journal()
            if not (self.committed or self._keeps_empty) and self._writer.is_new:
                self._refuse_replaced()
                self._path.unlink()
        if Pruning(self.reference_map, self._max_looks).surplus:
            self.removed = prune_looks(self._path, self._max_looks)
            self.committed -= self.removed

    def _run(self) -> None:
        while self._news.wait():
            is_reported = self.is_failing
            try:
                self.flush()
            except MapError as error:
                if self.lost:
                    return
                self._error = self._error if is_reported else error
                self._news.ring()
            self._end.wait(_COMMIT_EVERY_S)

    def _write(self) -> None:
        end = len(self.reference_map)
        if self.lost:
            raise MapError(self.lost)
        while self._is_behind(end):
            self._refuse_replaced()
            self._refuse_overwritten()
            stop = min(end, self.committed + _PLACES_AT_ONCE)
            self._writer.copy(self.reference_map, stop)
            self.committed, self.committed_s = stop, time.monotonic()
            self.reference_map.evict(stop, self._writer.reader.pictures)
            self.reference_map.trail.evict(self._writer.trailed)
            self._writer.checkpoint()
            self._left = _size_and_time(self._path)
            self._writer.reader.take_as_it_is()

    def _is_behind(self, end: int) -> bool:
        """Return whether places before `end`, or links of stored places, are not written yet."""
        links, linked = self.reference_map.links, self._writer.linked
        if self.committed < end or len(self.reference_map.trail) > self._writer.trailed:
            return True
        return bool(links.since(linked, self.committed))

    def _is_in_place(self) -> bool:
        with suppress(OSError):
            return self._path.stat().st_ino == self._file
        return False

    def _refuse_replaced(self) -> None:
        if self._is_in_place():
            return
        raise MapError(
            f'{self._path}: was moved or replaced; new places are not kept unless it is put back'
        )

    def _refuse_overwritten(self) -> None:
        """Give the file up if it became shorter, or others have made it another map."""
        now = _size_and_time(self._path)
        if now == self._left:
            return
        why = 'it is shorter' if now[0] < self._left[0] else ''
        try:
            if map_id_of(self._path) != self.reference_map.map_id:
                why = 'it is another map'
        except MapError as error:
            why = str(error.__cause__ or 'it is no map')
        if why:
            self._error = self._overwritten(why)
            raise self._error

    def _overwritten(self, why: str) -> MapError:
        """Leave a file alone that was cut short or overwritten; return what `save` raises once."""
        self.give_up(
            f'{self._path}: was cut short or overwritten while it was in use ({why}); the map '
            'does not grow; restore the file and start again'
        )
        return MapError(self.lost)


def _size_and_time(path: Path) -> tuple[int, int]:
    """Return the size of a file in bytes, and the time of its last change."""
    status = path.stat()
    return status.st_size, status.st_mtime_ns
