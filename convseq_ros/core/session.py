# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A session: recognisers with the map file that they use and, in online mode, extend."""

from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Event, Lock, Thread
import time

from convseq_ros.config import Config, EncodingConfig, KeyframeConfig
from convseq_ros.core.cameras import Cameras
from convseq_ros.core.compiled import slow_path
from convseq_ros.core.encoding.first_stage import Describe, with_first_stage
from convseq_ros.core.encoding.view import with_mask_read
from convseq_ros.core.map.database import MapLock
from convseq_ros.core.map.edit import prune_looks
from convseq_ros.core.map.online import Looks
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import MapWriter
from convseq_ros.errors import MapError

_COMMIT_EVERY_S = 0.5  # a crash may lose this much; each commit waits for the disk
_PLACES_AT_ONCE = 500  # in a transaction, 10 MB of memory


class NoAutosave:
    """A map that is only in memory, or does not grow."""

    committed = 0  # number of places that are safe in a file
    committed_s: float | None = None  # monotonic time at which the file grew last
    is_failing = False  # whether the last write failed
    removed = 0  # number of places that were removed when the map was closed

    def __init__(self, reference_map: ReferenceMap) -> None:
        self.reference_map = reference_map

    def save(self) -> None: ...

    def flush(self) -> None: ...

    def close(self) -> None: ...


class Autosave(NoAutosave):
    """
    Owns a map file, and writes added places to it in a background thread.

    A place is safe on disk half a second after it was added. Its picture is then released from
    memory, so that a map can grow all day. If the file is moved or replaced, or another program
    writes to it despite the lock, this is reported once and the map grows in memory; writing
    continues when the file is back.

    `append` is that of `MapWriter`. A new file without places is deleted at the end, unless
    `keeps_empty`. At the end no place keeps more than `max_looks` looks; 0 is no limit. MapError
    if another owner has the map, it cannot be written, or `MapWriter` refuses it.
    """

    def __init__(
        self,
        path: Path,
        encoding: EncodingConfig,
        keyframes: KeyframeConfig,
        append: bool | None = None,
        keeps_empty: bool = True,
        max_looks: int = 0,
    ) -> None:
        self._path, self._keeps_empty, self._max_looks = path, keeps_empty, max_looks
        with ExitStack() as opened:
            opened.enter_context(MapLock(path))
            self._writer = MapWriter(path, encoding, keyframes, append)
            opened.callback(self._writer.close)
            super().__init__(self._writer.reader.reference_map())
            self._file = path.stat().st_ino
            self.committed = self._writer.committed
            self._writer.linked = self.reference_map.links.looked_up_count
            self._writer.write_ahead()
            self._opened = opened.pop_all()
        self._writing = Lock()
        self._error: MapError | None = None  # raised by the next `save`
        self._news, self._end = Event(), Event()
        self._thread = Thread(target=self._run, name='autosave', daemon=True)
        self._thread.start()

    def save(self) -> None:
        """
        Request a write of the places added; call it after every frame.

        MapError, once, if a write failed. It is repeated until it works, without further errors.
        """
        if self._is_behind(len(self.reference_map)):
            self._news.set()
        error, self._error = self._error, None
        if error:
            raise error

    def flush(self) -> None:
        """Write all added places, and return when they are safe on disk; MapError if it fails."""
        with self._writing:
            try:
                self._write()
            except MapError:
                self.is_failing = True
                raise
            self.is_failing = False

    def close(self) -> None:
        """Write all added places, and close the file; MapError if it fails."""
        self._end.set()
        self._news.set()
        self._thread.join()
        with self._opened:
            self.flush()
            if self._is_in_place():
                self._writer.journal()
            if not (self.committed or self._keeps_empty) and self._writer.is_new:
                self._refuse_replaced()
                self._path.unlink()
        if self.has_surplus:
            self.removed = prune_looks(self._path, self._max_looks)
            self.committed -= self.removed

    @property
    def has_surplus(self) -> bool:
        """Whether a place has more looks than `max_looks`."""
        return bool(Looks(self.reference_map, self._max_looks).surplus)

    def _run(self) -> None:
        while self._news.wait() and not self._end.is_set():
            self._news.clear()
            is_reported = self.is_failing
            try:
                self.flush()
            except MapError as error:
                self._error = self._error if is_reported else error
                self._news.set()
            self._end.wait(_COMMIT_EVERY_S)

    def _write(self) -> None:
        end = len(self.reference_map)
        while self._is_behind(end):
            self._refuse_replaced()
            stop = min(end, self.committed + _PLACES_AT_ONCE)
            self._writer.copy(self.reference_map, stop)
            self.committed, self.committed_s = stop, time.monotonic()
            self.reference_map.evict(stop, self._writer.reader.pictures)
            self._writer.checkpoint()

    def _is_behind(self, end: int) -> bool:
        """Return whether places before `end`, or links of stored places, are not written yet."""
        links, linked = self.reference_map.links, self._writer.linked
        return self.committed < end or bool(links.since(linked, self.committed))

    def _is_in_place(self) -> bool:
        with suppress(OSError):
            return self._path.stat().st_ino == self._file
        return False

    def _refuse_replaced(self) -> None:
        if self._is_in_place():
            return
        raise MapError(f'{self._path}: was moved or replaced; new places are not kept')


class Session:
    """
    Opens a map and recognises its places; in online mode, also adds places and stores them.

    In preloaded mode the file must exist and is never written; in online mode it is made if
    missing, if `make` is True. Without a path the map is in memory: empty, and lost at the end.
    `sources` are the names of the cameras, if there are several; `describe` is the map's
    descriptor model, if it has one. MapError if the map cannot be opened or, in online mode,
    cannot be written, or another program adds to it.
    """

    def __init__(
        self,
        path: Path | None,
        config: Config,
        make: bool = True,
        sources: Sequence[str] = (),
        describe: Describe | None = None,
    ) -> None:
        config = with_first_stage(config, describe)
        self.path = path
        self.is_growing = config.online.grows
        self.is_persisted = path is not None and self.is_growing  # places are added to a file
        self._problem = ''  # why places of the map have more than `max_looks` looks
        encoding = with_mask_read(config.encoding, config.reading)
        if path and self.is_growing:
            max_looks = config.online.max_looks
            settings = path, encoding, config.keyframes, None if make else True, True, max_looks
            autosave = Autosave(*settings)
            if autosave.has_surplus:  # after a crash, or made with a higher limit
                try:
                    autosave.close()
                except MapError as error:  # such as a full disk: the map works without the limit
                    self._problem = f'max_looks is ignored: {error}'
                autosave = Autosave(*settings)
            self.autosave: NoAutosave = autosave
        elif path:
            self.autosave = NoAutosave(open_map(path, encoding))
        else:
            self.autosave = NoAutosave(ReferenceMap(encoding, keyframes=config.keyframes))
        reference_map = self.autosave.reference_map
        # Call `save` after every frame.
        self.save, self.flush = self.autosave.save, self.autosave.flush
        self.close = self.autosave.close
        try:
            self.cameras = Cameras(reference_map, config, sources, describe=describe)
        except BaseException:
            self.close()
            raise
        self.recognizer = self.cameras.first  # of the first camera, which adds places
        self.kernel = self.recognizer.matcher.kernel  # name of the kernel of pair scores
        # Why this kernel is slow, with the remedy; empty if NumPy was chosen.
        self.slow = '' if config.matching.kernel == 'numpy' else slow_path()
        # Distance between keyframes, of the map and by odometry of queries; 0 without a limit.
        self.keyframes_m = reference_map.keyframes.keyframe_distance_m

    @property
    def ignored(self) -> list[str]:
        """One line for each thing that is ignored: damaged links, a spacing unlike the map's."""
        wanted, default = self.recognizer.config.keyframes.spacing, KeyframeConfig().spacing
        used = self.recognizer.reference_map.keyframes.spacing
        problems = self.recognizer.reference_map.problem, self._problem
        return [problem for problem in problems if problem] + [
            f'{name} {wanted[name]} is ignored: {self.path} was made with {used[name]}; build the '
            'map again to change it'
            for name in used
            if wanted[name] not in (used[name], default[name])
        ]

    @property
    def added(self) -> int:
        """Number of places that were added in this session."""
        return len(self.recognizer.reference_map) - self.recognizer.mapping.session_start

    def warm_up(self) -> None:
        """Prepare the cameras, so that the first frame is as fast as the others."""
        self.cameras.warm_up()
