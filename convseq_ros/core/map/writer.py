# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writing a map file: places are only appended, in transactions."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
import sqlite3
from typing import Self
from uuid import uuid4

from convseq_ros import __version__
from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.encoding.mask import without_path
from convseq_ros.core.encoding.regions import global_descriptor as built_in
from convseq_ros.core.graph.links import Row
from convseq_ros.core.graph.packed_pose import packed_pose
from convseq_ros.core.map.crash_recovery import EMPTY, open_to_write
from convseq_ros.core.map.database import as_map_error, BESIDE, Database
from convseq_ros.core.map.format import keyframe_row, MapSession, Settings
from convseq_ros.core.map.lock import MapLock
from convseq_ros.core.map.place import Picture, Place, unpack_cells
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Halves
from convseq_ros.errors import MapError
from convseq_ros.io.regular_file import complete_or_absent

_AT_ONCE = 64  # places that are read together: 1 MB, more with images


class MapWriter:
    """
    Appends places to a map file; use it as a context manager.

    Places are safe on disk after `commit`, which updates `committed`; so they are when the context
    ends without an error. A file is made in one transaction, so it is complete or empty; an empty
    file or a map without places may be made again. Hold the `MapLock` while writing. With
    `append`, the map must exist; with None it is made if missing, and `is_new` is True then. A new
    map gets the `map_id`, or by default a new UUID.

    MapError if a new map exists already, or an existing one is missing, foreign, damaged or made
    with other settings; later, if the disk is full.
    """

    def __init__(
        self,
        path: Path,
        encoding: EncodingConfig,
        keyframes: KeyframeConfig,
        append: bool | None = False,
        map_id: str = '',
        position_sigma_m: float = 0.0,
    ) -> None:
        encoding = without_path(encoding)
        # Rows of links, and keyframes, of the source that are written already.
        self._path, self.linked, self.trailed = path, 0, 0
        if append and not path.is_file():
            remedy = f'make one with `convseq build-map RECORDING {path}`'
            raise MapError(f'{path}: no such map to add to; {remedy}')
        with as_map_error(path):
            self._database = open_to_write(path)
            try:
                settings = Settings(map_id or str(uuid4()), encoding, keyframes, position_sigma_m)
                self.is_new = self._make(settings, append)
                self.reader = MapReader(path, encoding, keyframes)
                self._count = self.committed = len(self.reader)
                self._takes_links = _takes(self._database, 'links')
                self._takes_keyframes = _takes(self._database, 'keyframes')
                self._sessions = self._database.number('SELECT count(*) FROM sessions')
            except BaseException:
                self.close()
                raise

    def reference_map(self) -> ReferenceMap:
        """Return the map of the file, which may grow; its links are written already."""
        opened = self.reader.reference_map()
        self.linked, self.trailed = opened.links.looked_up_count, len(opened.trail)
        return opened

    def _make(self, settings: Settings, append: bool | None) -> bool:
        """Make the file unless it is a map to append to; return whether it was made."""
        if self._database.number('PRAGMA page_count'):
            found = MapReader(self._path)  # refuses what is no map
            if append is not False:
                return False
            if len(found):
                raise MapError(
                    f'{self._path}: exists already; delete it first, or use build-map --append'
                )
        elif append:
            raise MapError(f'{self._path}: {EMPTY}; make it without appending')
        about = {**settings.rows, 'tool': __version__}
        with self._database.transaction('IMMEDIATE'):
            self._database.make_tables()
            for row in about.items():
                self._database.insert('about', row)
        return True

    def _insert(self, table: str, *row: object) -> None:
        with as_map_error(self._path):
            self._database.begin()
            self._database.insert(table, row)

    def add(self, place: Place, picture: Picture, global_descriptor: Halves) -> None:
        """Append a place; its global descriptor has shape (n,)."""
        while self._sessions <= place.session:
            self.add_session(MapSession(str(uuid4()), '', place.stamp_ns))
        index, descriptor = self._count, global_descriptor.astype('<f2').tobytes()
        vector, has_model = descriptor, bool(self.reader.encoding.descriptor_model)
        if has_model:  # the built-in descriptor, for use without the model
            descriptor = built_in(unpack_cells(picture.packed)).astype('<f2').tobytes()
        numbers = place.stamp_ns, place.source, *place.pose_numbers, place.session
        cells = picture.packed.astype('<f2').tobytes()
        self._insert('places', index, *numbers, descriptor)
        self._insert('pictures', index, cells, picture.thumbnail, picture.keypoints)
        self._insert('images', index, picture.image)
        if has_model:
            self._insert('vectors', index, vector)
        self._count += 1

    def add_session(self, session: MapSession) -> None:
        """Append a session."""
        self._insert('sessions', self._sessions, *session.row)
        self._sessions += 1

    def append(self, reference_map: ReferenceMap, end: int) -> None:
        """Append the new sessions, places (up to `end`, exclusive) and links of a map."""
        for session in reference_map.sessions[self._sessions :]:
            self.add_session(session)
        while (start := self._count) < end:
            indices = range(start, min(start + _AT_ONCE, end))
            pictures = reference_map.pictures(indices, with_images=True)
            descriptors = reference_map.global_descriptors
            for index, picture in zip(indices, pictures, strict=True):
                self.add(reference_map.places[index], picture, descriptors[index])
        if rows := reference_map.links.since(self.linked, self._count):
            with as_map_error(self._path):
                self._database.begin()
                if self._takes_links:
                    write_links(self._database, rows)
            self.linked += len(rows)
        for keyframe in reference_map.trail.since(self.trailed):
            if self._takes_keyframes:
                self._insert('keyframes', self.trailed, *keyframe_row(keyframe))
            self.trailed += 1

    def copy(self, reference_map: ReferenceMap, end: int) -> None:
        """Append and commit; do neither if it fails."""
        before = self._sessions, self.linked, self.trailed
        try:
            self.append(reference_map, end)
            self.commit()
        except MapError:
            self._database.roll_back()
            self._count, (self._sessions, self.linked, self.trailed) = self.committed, before
            raise

    def commit(self) -> None:
        """Make all added places safe on disk."""
        with as_map_error(self._path):
            self._database.commit()
        self.committed = self._count

    def write_ahead(self) -> None:
        """Use a write-ahead log until `journal`, if possible, so that readers need not wait."""
        with self.reader.released():
            try:
                self._database.write_ahead()
            except sqlite3.Error:
                self._database.close()
                self._database = open_to_write(self._path)

    def checkpoint(self) -> None:
        """Move commits from the write-ahead log to the file, if there is a log."""
        with suppress(sqlite3.Error):  # the log is safe; the next commit reports a failing disk
            self._database.checkpoint()

    def journal(self) -> None:
        """Move all commits to the file, and remove the write-ahead log."""
        with self.reader.released():
            self._database.journal()

    def close(self) -> None:
        """Close the file; what was not committed is lost."""
        self._database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: object, _trace: object) -> None:
        with closing(self._database):
            if error is None:
                self.commit()


def save_map(reference_map: ReferenceMap, path: Path, is_new: bool = False) -> None:
    """
    Write a map to a file, which is replaced in one step, or not at all.

    MapError if another program adds to the map, the disk is full or, with `is_new`, the file
    exists.
    """
    with MapLock(path):
        if is_new:
            refuse_existing(path)
        _put(reference_map, path)


def rewrite(path: Path, change: Callable[[ReferenceMap], ReferenceMap | None]) -> None:
    """
    Replace a map file by what `change` makes of its map, in one step or not at all.

    `change` may return the map that it is given; with None the file stays as it is. MapError as
    for `save_map`.
    """
    with MapLock(path):
        changed = change(open_map(path))
        if changed is not None:
            _put(changed, path)


def refuse_existing(path: Path) -> None:
    """Raise MapError if a file that should be new exists already."""
    if path.exists():
        raise MapError(f'{path}: exists already; name another file')


def _put(new: ReferenceMap, path: Path) -> None:
    settings = new.encoding, new.keyframes, False, new.map_id, new.position_sigma_m
    with replaced(path) as part, MapWriter(part, *settings) as writer:
        writer.append(new, len(new))


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """
    Yield a temporary path; the map made there replaces a file at the end, or MapError.

    Hold the `MapLock` of the file.
    """
    target = path.resolve()
    try:
        with complete_or_absent(target) as part:
            try:
                yield part
            except MapError as error:
                raise MapError(str(error).replace(str(part), str(path))) from error
            _delete_journal(target)
    except OSError as error:
        raise MapError(f'{path}: cannot write the map ({error.strerror})') from error


def _delete_journal(path: Path) -> None:
    """Delete the journals of a file before it is replaced: SQLite would apply them to the new."""
    journals = [path.with_name(path.name + end) for end in BESIDE]
    if any(journal.exists() for journal in journals):
        with suppress(MapError), as_map_error(path):
            open_to_write(path).close()  # repairs the file if possible
        for journal in journals:
            journal.unlink(missing_ok=True)


def write_links(database: Database, rows: Sequence[Row]) -> None:
    """Write links in a transaction that is open already."""
    for place, link, is_unlinked in rows:
        no_chance = 0.0 if is_unlinked else None
        row: tuple[object, ...] = (place, None, None, no_chance, None, None)
        if link is not None:
            relative = link.relative and packed_pose(link.relative)
            row = place, link.other, link.anchor, link.confidence, link.inliers, relative
        database.insert('links', row, 'INSERT OR REPLACE')


def _takes(database: Database, table: str) -> bool:
    """Return whether a table is readable, so that rows can be added."""
    try:
        return database.number(f'SELECT count(*) FROM {table}') >= 0
    except sqlite3.DatabaseError:
        database.roll_back()
        return False
