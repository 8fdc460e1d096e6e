# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writing a map file: append-only, a transaction at a time."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
import sqlite3
from typing import Self
from uuid import uuid4

from convseq_ros import __version__
from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.encoding.regions import global_descriptor as built_in
from convseq_ros.core.encoding.view import with_mask_read
from convseq_ros.core.graph.links import Row
from convseq_ros.core.map.crash_recovery import EMPTY, open_to_write
from convseq_ros.core.map.database import BESIDE, Database, explained, MapLock
from convseq_ros.core.map.format import MapSession, packed_pose, Settings
from convseq_ros.core.map.place import Picture, Place, unpack_cells
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Halves
from convseq_ros.errors import MapError
from convseq_ros.regular_file import complete_or_absent

_AT_ONCE = 64  # places that are read in one go: 1 MB, and more with images

Progress = Callable[[Sequence[int]], Iterable[int]]  # yields what it is given, and shows how far


class MapWriter:
    """
    Appends places to a map file; use it as a context manager.

    They are safe on disk after `commit`, which counts them in `committed`, and at the end of work
    that was not interrupted. A file is made in one transaction, so that none is half made; an
    empty one is no map yet, and a map without places may be made anew. One program at a time may
    write, who holds the `MapLock`. `append` says whether there must be a map; None takes one, or
    makes it, as `is_new` tells. A new one has a `map_id`, a UUID, by default its own.

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
    ) -> None:
        self._path, self.linked = path, 0  # rows of the links of the map that is appended
        if append and not path.is_file():
            raise MapError(f'{path}: no such map to add to')
        with explained(path):
            self._database = open_to_write(path)
            try:
                settings = Settings(map_id or str(uuid4()), with_mask_read(encoding), keyframes)
                self.is_new = self._make(settings, append)
                self.reader = MapReader(path, encoding, keyframes)
                self._count = self.committed = len(self.reader)
                self._takes_links = _takes_links(self._database)
                self._sessions = self._database.number('SELECT count(*) FROM sessions')
            except BaseException:
                self.close()
                raise

    def _make(self, settings: Settings, append: bool | None) -> bool:
        """Make the file, unless it is a map that may be there; return whether it was made."""
        if self._database.number('PRAGMA page_count'):
            if append is not False:
                return False
            if len(MapReader(self._path)):
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
        with explained(self._path):
            self._database.begin()
            self._database.insert(table, row)

    def add(self, place: Place, picture: Picture, global_descriptor: Halves) -> None:
        """Append a place; its global descriptor has shape (n,)."""
        while self._sessions <= place.session:
            self.add_session(MapSession(str(uuid4()), '', place.stamp_ns))
        index, descriptor = self._count, global_descriptor.astype('<f2').tobytes()
        encoding, vector = self.reader.encoding, descriptor
        has_both = bool(encoding.descriptor_model) and encoding.keeps_cells
        if has_both:  # what is built in stays, for who has no model
            descriptor = built_in(unpack_cells(picture.packed)).astype('<f2').tobytes()
        where = place.stamp_ns, place.source, *place.pose_numbers, place.session
        cells = picture.packed.astype('<f2').tobytes()
        self._insert('places', index, *where, descriptor)
        self._insert('pictures', index, cells, picture.thumbnail)
        self._insert('images', index, picture.image)
        if picture.depths is not None:
            self._insert('depths', index, picture.depths)
        if has_both:
            self._insert('vectors', index, vector)
        self._count += 1

    def add_session(self, session: MapSession) -> None:
        """Append a session, of which places may be."""
        self._insert('sessions', self._sessions, *session.row)
        self._sessions += 1

    def append(self, reference_map: ReferenceMap, end: int) -> None:
        """Append what is not here yet of a map: sessions, places up to before `end`, links."""
        for session in reference_map.sessions[self._sessions :]:
            self.add_session(session)
        while (start := self._count) < end:
            some = range(start, min(start + _AT_ONCE, end))
            pictures = reference_map.pictures(some, with_images=True)
            descriptors = reference_map.global_descriptors
            for index, picture in zip(some, pictures, strict=True):
                self.add(reference_map.places[index], picture, descriptors[index])
        if rows := reference_map.links.since(self.linked, self._count):
            with explained(self._path):
                self._database.begin()
                if self._takes_links:
                    write_links(self._database, rows)
            self.linked += len(rows)

    def copy(self, reference_map: ReferenceMap, end: int) -> None:
        """Append and commit; of all that, nothing is done if it fails."""
        before = self._sessions, self.linked
        try:
            self.append(reference_map, end)
            self.commit()
        except MapError:
            self._database.roll_back()
            self._count, (self._sessions, self.linked) = self.committed, before
            raise

    def commit(self) -> None:
        """Make what was added safe."""
        with explained(self._path):
            self._database.commit()
        self.committed = self._count

    def write_ahead(self) -> None:
        """Have no reader wait for a commit until `journal`, where that is possible."""
        with self.reader.released():
            try:
                self._database.write_ahead()
            except sqlite3.Error:
                self._database.close()
                self._database = open_to_write(self._path)

    def settle(self) -> None:
        """Have the file alone hold all that was committed, soon, if it was written ahead."""
        with suppress(sqlite3.Error):  # it is safe; if the disk fails, the next commit says so
            self._database.settle()

    def journal(self) -> None:
        """Have the file alone hold all, with nothing beside it."""
        with self.reader.released():
            self._database.journal()

    def close(self) -> None:
        """Close the file without a commit."""
        self._database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: object, _trace: object) -> None:
        with closing(self._database):
            if error is None:
                self.commit()


def save_map(
    reference_map: ReferenceMap,
    path: Path,
    progress: Progress = iter,
    refuse: Callable[[], None] = lambda: None,
) -> None:
    """
    Write a map as it is now, replacing a file in one step, or, with a MapError, not at all.

    Nobody else changes the file from when on `refuse` is called, which may raise a MapError.
    """
    settings, end = (reference_map.encoding, reference_map.keyframes), len(reference_map)
    with replaced(path) as part:
        refuse()
        with MapWriter(part, *settings, map_id=reference_map.map_id) as writer:
            for start in progress(range(0, end or 1, _AT_ONCE)):
                writer.append(reference_map, min(start + _AT_ONCE, end))


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Give a name to make a map under, which replaces it at the end; MapError if it cannot."""
    target = path.resolve()
    with MapLock(path):
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
    """Delete what a crash left beside a file: it would be taken for what replaces the file."""
    beside = [path.with_name(path.name + end) for end in BESIDE]
    if any(one.exists() for one in beside):
        with suppress(MapError), explained(path), closing(open_to_write(path)) as database:
            database.number('PRAGMA page_count')  # mends the file, if it can be
        for one in beside:
            one.unlink(missing_ok=True)


def write_links(database: Database, rows: Sequence[Row]) -> None:
    """Write links, in a transaction that is begun."""
    for place, one in rows:
        row: tuple[object, ...] = (place, *(None,) * 5)
        if one is not None:
            relative = one.relative and packed_pose(one.relative)
            row = place, one.other, one.anchor, one.confidence, one.inliers, relative
        database.insert('links', row, 'INSERT OR REPLACE')


def _takes_links(database: Database) -> bool:
    """Return whether a file takes further links: not if their table cannot be read."""
    try:
        return database.number('SELECT count(*) FROM links') >= 0
    except sqlite3.DatabaseError:
        database.roll_back()
        return False
