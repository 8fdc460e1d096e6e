# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading a map file: what is held in memory at once, and the rest on demand."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
import shutil
import sqlite3
import tempfile
from threading import Lock
from typing import Any
import weakref

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.encoding.descriptor import cell_shape
from convseq_ros.core.map.format import checked_settings, decode_cells, row_crc
from convseq_ros.core.map.place import Picture, Places
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.errors import MapError

_ROWS_AT_ONCE = 2048  # of `places`, for some MB of memory
_DAMAGE = (sqlite3.Error, OverflowError, ValueError, TypeError)  # what damaged rows may raise


def open_map(
    path: str | Path,
    encoding: EncodingConfig | None = None,
    keyframes: KeyframeConfig | None = None,
) -> ReferenceMap:
    """
    Open a map, with settings and errors as for `MapReader`.

    Cells and thumbnails are read when they are asked for, and found damaged then; so the file must
    stay where it is while the map is used.
    """
    reader = MapReader(Path(path), encoding, keyframes)
    return ReferenceMap(reader.encoding, reader.places(), reader.pictures, reader.keyframes)


class MapReader:
    """
    A map file that is open for reading; any thread may read.

    The file is not changed. If a crash left it with a journal, a copy is mended and read. Without
    an `encoding` of queries, or the `keyframes` that will be added, the map's own are taken.
    MapError if the file is missing, foreign, damaged, of another format or made with other
    settings; later, if it is damaged where it is read then.
    """

    def __init__(
        self,
        path: Path,
        encoding: EncodingConfig | None = None,
        keyframes: KeyframeConfig | None = None,
    ) -> None:
        self._path, self._lock = path, Lock()
        with self._explained():
            self._database = _connected(path)
            # A thread may still read when the process ends; what is only read needs no closing.
            weakref.finalize(self, self._database.close).atexit = False
            settings = checked_settings(path, self._database, encoding, keyframes)
        self.encoding, self.keyframes = settings
        self._cell_shape = cell_shape(self.encoding.image_size_px)

    def about(self) -> dict[str, Any]:
        """Return what the file says about itself, and how many thumbnails it holds."""
        with self._explained():
            about = dict(self._database.execute('SELECT name, value FROM about'))
            seen = 'SELECT count(*) FROM pictures WHERE length(thumbnail) > 0'
            return {**about, 'thumbnails': self._database.execute(seen).fetchone()[0]}

    def places(self) -> Places:
        """Return what a map holds in memory of its places, checked."""
        with self._explained():
            count = '(SELECT coalesce(max(reference_index), -1) + 1 FROM {})'
            both = f'SELECT {count.format("places")}, {count.format("pictures")}'
            length, pictures = self._database.execute(both).fetchone()
            # The last index may be any number: memory is taken for the rows that are there.
            (rows_there,) = self._database.execute('SELECT count(*) FROM places').fetchone()
            if length != pictures:
                raise self._damaged(f'reference {min(length, pictures)} is missing')
            places = Places(self._cell_shape, rows_there)
            rows = self._database.execute('SELECT * FROM places ORDER BY reference_index')
            for some in iter(partial(rows.fetchmany, _ROWS_AT_ONCE), []):
                for index, row in enumerate(some, len(places)):
                    if row[0] != index or row[-1] != row_crc(row[:-2], row[-2]):
                        raise self._damaged(f'reference {index} fails its checksum')
                places.extend(some)
            if len(places) != length:
                raise self._damaged(f'reference {len(places)} is missing')
        return places

    def pictures(self, indices: Sequence[int]) -> list[Picture]:
        """Return the cells and the thumbnails of places, in the order asked for, checked."""
        with self._explained(), self._database:
            # One transaction for many: what a read costs is mostly the lock on the file.
            self._database.execute('BEGIN')
            found = {index: self._picture(index) for index in dict.fromkeys(indices)}
        return [found[index] for index in indices]

    def _picture(self, index: int) -> Picture:
        statement = 'SELECT cells, thumbnail, crc32 FROM pictures WHERE reference_index = ?'
        row = self._database.execute(statement, (index,)).fetchone()
        if row is None:
            raise self._damaged(f'reference {index} is missing')
        cells, thumbnail, crc = row
        if crc != row_crc(index, cells, thumbnail):
            raise self._damaged(f'reference {index} fails its checksum')
        return Picture(decode_cells(cells, self._cell_shape), thumbnail)

    def _damaged(self, reason: object) -> MapError:
        in_one_line = ' '.join(str(reason).split())
        return MapError(f'{self._path}: damaged map ({in_one_line}); build it again')

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            with self._lock:
                yield
        except OSError as error:
            raise MapError(f'{self._path}: cannot be read ({error.strerror})') from error
        except _DAMAGE as error:
            if getattr(error, 'sqlite_errorcode', None) == sqlite3.SQLITE_BUSY:
                raise MapError(f'{self._path}: is being written to; try again') from error
            raise self._damaged(error) from error


def _connected(path: Path) -> sqlite3.Connection:
    if path.is_dir():
        raise MapError(f'{path}: is a folder; name the map file in it')
    if not path.is_file():
        raise MapError(f'{path}: no such map; make one with `convseq build-map RECORDING {path}`')
    with path.open('rb') as file:
        if file.read(16) != b'SQLite format 3\0':
            raise MapError(f'{path}: not a convseq map')
    database = _connect(path, 'ro')
    try:
        (pages,) = database.execute('PRAGMA page_count').fetchone()
        (page_bytes,) = database.execute('PRAGMA page_size').fetchone()
    except sqlite3.OperationalError:
        database.close()
        journal = path.with_name(path.name + '-journal')
        if not journal.exists():
            raise
        # A copy is mended, of which only the connection knows.
        with tempfile.TemporaryDirectory() as folder:
            shutil.copy(journal, folder)
            database = _connect(Path(shutil.copy(path, folder)), 'rw')
            database.execute('PRAGMA schema_version')
        return database
    if path.stat().st_size < pages * page_bytes:
        database.close()
        raise MapError(f'{path}: damaged map (cut short); build it again')
    return database


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    address = f'{path.absolute().as_uri()}?mode={mode}'
    return sqlite3.connect(address, uri=True, check_same_thread=False)
