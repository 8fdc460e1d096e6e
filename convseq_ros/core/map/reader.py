# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading a map file: what is held in memory at once, and the rest on demand."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
import shutil
import sqlite3
import sys
import tempfile
from threading import Lock
from typing import Any
import weakref

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.encoding.descriptor import cell_shape
from convseq_ros.core.map.format import checked_settings, decode_cells, picture_crc, place_crc
from convseq_ros.core.map.place import Columns, empty_columns, Picture
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.errors import MapError
import numpy as np

_ROWS_AT_ONCE = 2048  # of `places`, for some MB of memory
_PICTURES_AT_ONCE = 256  # of `pictures`; SQLite takes 999 values in a statement
_DAMAGE = (OverflowError, UnicodeDecodeError, ValueError, TypeError)


def open_map(
    path: str | Path,
    encoding: EncodingConfig | None = None,
    keyframes: KeyframeConfig | None = None,
) -> ReferenceMap:
    """
    Open a map: all that is searched in; cells and thumbnails are read when they are asked for.

    The file is not changed, and must stay where it is while the map is used. The settings are as
    for `MapReader`, and so are the errors; damaged cells are found when they are read.
    """
    reader = MapReader(Path(path), encoding, keyframes)
    return ReferenceMap(reader.encoding, reader.columns(), reader, reader.keyframes)


class MapReader:
    """
    A map file that is open for reading; any thread may read.

    The file is not changed. If a crash left it with a journal, a copy is mended and read. Without
    an `encoding` of queries, or the `keyframes` that will be added, the map's own are taken.

    Raises
    ------
    MapError
        If the file is missing, foreign, damaged, of another format or made with other settings;
        later, if it is damaged where it is read then.

    """

    def __init__(
        self,
        path: Path,
        encoding: EncodingConfig | None = None,
        keyframes: KeyframeConfig | None = None,
    ) -> None:
        self._path = path
        self._lock = Lock()
        with self._explained():
            self._database = _connected(path)
            self._end = weakref.finalize(self, self._database.close)
            # A thread may still read when the process ends; what is only read needs no closing.
            self._end.atexit = False
            self.encoding, self.keyframes = checked_settings(
                path, self._database, encoding, keyframes
            )
        self._cell_shape = cell_shape(self.encoding.image_size_px)

    def close(self) -> None:
        """Close the file."""
        self._end()

    def about(self) -> dict[str, Any]:
        """Return what the file says about itself, and how many thumbnails it holds."""
        with self._explained():
            about = dict(self._database.execute('SELECT name, value FROM about'))
            seen = 'SELECT count(*) FROM pictures WHERE length(thumbnail) > 0'
            return {**about, 'thumbnails': self._database.execute(seen).fetchone()[0]}

    def columns(self) -> Columns:
        """Return what a map holds in memory of all its places, checked."""
        with self._explained():
            rows = self._database.execute('SELECT * FROM places ORDER BY reference_index')
            last = 'SELECT coalesce(max(reference_index), -1) FROM {}'
            length, pictures = (
                self._database.execute(last.format(table)).fetchone()[0] + 1
                for table in ('places', 'pictures')
            )
            if length != pictures:
                raise self._damaged(f'reference {min(length, pictures)} is missing')
            columns = empty_columns(self._cell_shape, length)
            for start in count(0, _ROWS_AT_ONCE):
                some = rows.fetchmany(_ROWS_AT_ONCE)
                self._check(some, start)
                self._fill(columns, some, start)
                if len(some) < _ROWS_AT_ONCE:
                    break
            if len(columns.sources) != length:
                raise self._damaged(f'reference {len(columns.sources)} is missing')
        return columns

    def pictures(self, indices: Sequence[int]) -> list[Picture]:
        """Return the cells and the thumbnails of places, in the order asked for, checked."""
        found: dict[int, Picture] = {}
        with self._explained():
            for start in range(0, len(indices), _PICTURES_AT_ONCE):
                some = indices[start : start + _PICTURES_AT_ONCE]
                # One statement for many: what a read costs is mostly the lock on the file.
                statement = f'SELECT * FROM pictures WHERE reference_index IN ({_marks(some)})'
                for row in self._database.execute(statement, some):
                    found[row[0]] = self._picture(*row)
            for index in indices:
                if index not in found:
                    raise self._damaged(f'reference {index} is missing')
        return [found[index] for index in indices]

    def _picture(self, index: int, cells: bytes, thumbnail: bytes, crc: int) -> Picture:
        if crc != picture_crc(index, cells, thumbnail):
            raise self._damaged(f'reference {index} fails its checksum')
        return Picture(decode_cells(cells, self._cell_shape), thumbnail)

    def _check(self, rows: list[tuple[Any, ...]], start: int) -> None:
        for index, (*plain, pooled, crc) in enumerate(rows, start):
            if plain[0] != index or crc != place_crc(tuple(plain), pooled):
                raise self._damaged(f'reference {index} fails its checksum')

    @staticmethod
    def _fill(columns: Columns, rows: list[tuple[Any, ...]], start: int) -> None:
        if not rows:
            return
        _, stamps_ns, sources, *poses, pooled, _ = zip(*rows, strict=True)
        here = slice(start, start + len(rows))
        columns.stamps_ns[here] = stamps_ns
        columns.sources.extend(map(sys.intern, sources))
        columns.poses[here] = np.array(poses, np.float64).T
        descriptors = np.frombuffer(b''.join(pooled), '<f2')
        columns.global_descriptors[here] = descriptors.reshape(len(rows), -1)

    def _damaged(self, reason: object) -> MapError:
        in_one_line = ' '.join(str(reason).split())
        return MapError(f'{self._path}: damaged map ({in_one_line}); build it again')

    @contextmanager
    def _explained(self) -> Iterator[None]:
        path = self._path
        try:
            with self._lock:
                yield
        except OSError as error:
            raise MapError(f'{path}: cannot be read ({error.strerror})') from error
        except sqlite3.Error as error:
            if getattr(error, 'sqlite_errorcode', None) == sqlite3.SQLITE_BUSY:
                raise MapError(f'{path}: is being written to; try again') from error
            raise self._damaged(error) from error
        except _DAMAGE as error:
            raise self._damaged(error) from error


def _marks(values: Sequence[int]) -> str:
    return ','.join('?' * len(values))


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
        return _mended_copy(path, journal)
    if path.stat().st_size < pages * page_bytes:
        database.close()
        raise MapError(f'{path}: damaged map (cut short); build it again')
    return database


def _mended_copy(path: Path, journal: Path) -> sqlite3.Connection:
    """Return a connection to a copy of which only that connection knows."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(journal, folder)
        database = _connect(Path(shutil.copy(path, folder)), 'rw')
        database.execute('PRAGMA schema_version')
    return database


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    address = f'{path.absolute().as_uri()}?mode={mode}'
    return sqlite3.connect(address, uri=True, check_same_thread=False)
