# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reference map on disk: one SQLite file, append-only, never changed by opening it."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
import json
import os
from pathlib import Path
import shutil
import sqlite3
import tempfile
from types import TracebackType
from typing import Any, Self
import zlib

from convseq_ros import __version__
from convseq_ros.config import EncodingConfig
from convseq_ros.core.reference_map import Place, ReferenceMap
from convseq_ros.core.types import Pose
from convseq_ros.errors import ConfigError, MapError
import numpy as np
import numpy.typing as npt

FORMAT_VERSION = 1
_APPLICATION_ID = 0x43565351
_POSE = ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')
_SCHEMA = f"""
PRAGMA application_id = {_APPLICATION_ID};
PRAGMA user_version = {FORMAT_VERSION};
CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE frames (
    reference_index INTEGER PRIMARY KEY, stamp_ns INTEGER NOT NULL, source TEXT NOT NULL,
    x REAL, y REAL, z REAL, qx REAL, qy REAL, qz REAL, qw REAL,
    thumbnail BLOB NOT NULL, cells BLOB NOT NULL, crc32 INTEGER NOT NULL
);
"""
_SELECT = f'SELECT reference_index, stamp_ns, source, {", ".join(_POSE)}, thumbnail, cells, crc32'
_Row = tuple[Any, ...]


class MapWriter:
    """
    Appends places to a map file; use it as a context manager.

    Places are safe on disk after `commit`, and at the end, also when the work was interrupted.

    Parameters
    ----------
    path : Path
        The file; a new one is made unless `append`.
    encoding : EncodingConfig
        How the images are encoded.
    append : bool
        Add to an existing map, which must be of the same encoding.

    Raises
    ------
    MapError
        If a new file exists already, or an existing one is missing, foreign, damaged or of another
        encoding; later, if the disk is full.

    """

    def __init__(self, path: Path, encoding: EncodingConfig, append: bool = False) -> None:
        self.encoding = encoding
        self._path = path
        if append:
            self._count = len(open_map(path, encoding))
        elif path.exists():
            raise MapError(f'{path}: exists already; append to it, or delete it first')
        else:
            self._count = 0
        with self._explained():
            self._database = sqlite3.connect(path)
            if not append:
                self._database.executescript(_SCHEMA)
                about = {'encoding': json.dumps(cell_settings(encoding)), 'tool': __version__}
                self._database.executemany('INSERT INTO about VALUES (?, ?)', about.items())
                self._database.commit()

    def add(self, place: Place, packed: npt.NDArray[np.float16]) -> None:
        """Append a place and its packed cells."""
        pose = (*place.pose.position, *place.pose.orientation) if place.pose else ()
        numbers: list[float | None] = [*map(float, pose)] or [None] * len(_POSE)
        values = (
            self._count, place.stamp_ns, place.source, *numbers, place.thumbnail, packed.tobytes(),
        )  # fmt: skip
        with self._explained():
            marks = ', '.join('?' * (len(values) + 1))
            self._database.execute(f'INSERT INTO frames VALUES ({marks})', (*values, _crc(values)))
        self._count += 1

    def commit(self) -> None:
        """Make what was added safe."""
        with self._explained():
            self._database.commit()

    def __len__(self) -> int:
        return self._count

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with closing(self._database):
            if not isinstance(error, MapError):
                self.commit()

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise MapError(f'{self._path}: cannot write ({error}); is the disk full?') from error


def save_map(reference_map: ReferenceMap, path: Path) -> None:
    """
    Write a whole map, replacing the file in one step.

    Raises
    ------
    MapError
        If it cannot be written; an existing file is then unchanged.

    """
    part = path.with_name(path.name + '.part')
    try:
        part.unlink(missing_ok=True)
        with MapWriter(part, reference_map.encoding) as writer:
            for index, place in enumerate(reference_map.places):
                writer.add(place, reference_map.packed(index))
        os.replace(part, path)
    except (MapError, OSError) as error:
        part.unlink(missing_ok=True)
        raise MapError(f'{path}: cannot write the map ({error})') from error


def open_map(path: Path, encoding: EncodingConfig | None = None) -> ReferenceMap:
    """
    Read a map.

    Parameters
    ----------
    path : Path
        The file; it is not changed.
    encoding : EncodingConfig, optional
        How query images will be encoded; without it the map's own settings are taken.

    Raises
    ------
    MapError
        If the file is missing, foreign, damaged, of a newer format or made with other settings.

    """
    if not path.is_file():
        raise MapError(f'{path}: no such map; make one with `convseq build-map RECORDING {path}`')
    try:
        with _connected(path) as database:
            reference_map = ReferenceMap(_checked_settings(path, database, encoding))
            for row in database.execute(f'{_SELECT} FROM frames ORDER BY reference_index'):
                _add(reference_map, row, path)
    except OSError as error:
        raise MapError(f'{path}: cannot be read ({error.strerror})') from error
    except (sqlite3.Error, OverflowError, UnicodeDecodeError, ValueError, TypeError) as error:
        raise MapError(f'{path}: damaged map ({error}); build it again') from error
    return reference_map


def describe_file(path: Path) -> dict[str, str]:
    """Return what a map file says about itself: its encoding and the tool that made it."""
    open_map(path)
    with _connected(path) as database:
        return dict(database.execute('SELECT name, value FROM about'))


def cell_settings(encoding: EncodingConfig) -> dict[str, int]:
    """Return the settings that the stored cells depend on."""
    return {'image_size_px': encoding.image_size_px}


def _checked_settings(
    path: Path, database: sqlite3.Connection, encoding: EncodingConfig | None
) -> EncodingConfig:
    if database.execute('PRAGMA application_id').fetchone()[0] != _APPLICATION_ID:
        raise MapError(f'{path}: not a convseq map but another SQLite file')
    version = database.execute('PRAGMA user_version').fetchone()[0]
    if version != FORMAT_VERSION:
        raise MapError(
            f'{path}: map format {version}, this program reads {FORMAT_VERSION}; '
            f'{"update convseq_ros" if version > FORMAT_VERSION else "build the map again"}'
        )
    about = dict(database.execute('SELECT name, value FROM about'))
    try:
        settings = json.loads(about['encoding'])
        made_with = EncodingConfig(**settings)
    except (KeyError, TypeError, ValueError, ConfigError) as error:
        raise MapError(f'{path}: damaged map (settings: {error}); build it again') from error
    for name, wanted in cell_settings(encoding or made_with).items():
        if settings[name] != wanted:
            raise MapError(
                f'{path}: made with {name} {settings[name]}, asked for {wanted}; '
                f'set {name} to {settings[name]} or build the map again'
            )
    return encoding or made_with


def _add(reference_map: ReferenceMap, row: _Row, path: Path) -> None:
    *values, crc = row
    index, stamp_ns, source = values[:3]
    pose, (thumbnail, cells) = values[3:10], values[10:]
    if index != len(reference_map) or crc != _crc(tuple(values)):
        raise MapError(
            f'{path}: damaged map (reference {len(reference_map)} fails its checksum); '
            f'build it again'
        )
    packed = np.frombuffer(cells, np.float16).reshape(reference_map.cell_shape)
    where = None if pose[0] is None else Pose(tuple(pose[:3]), tuple(pose[3:]))
    reference_map.add(Place(stamp_ns, source, where, thumbnail), packed)


def _crc(values: _Row) -> int:
    *plain, thumbnail, cells = values
    return zlib.crc32(cells, zlib.crc32(thumbnail, zlib.crc32(repr(plain).encode())))


@contextmanager
def _connected(path: Path) -> Iterator[sqlite3.Connection]:
    """Open for reading; a file that a crash left with its journal is mended in a copy."""
    with path.open('rb') as file:
        if file.read(16) != b'SQLite format 3\0':
            raise MapError(f'{path}: not a convseq map')
    journal = path.with_name(path.name + '-journal')
    with tempfile.TemporaryDirectory() as folder:
        mode = 'ro'
        if journal.exists():
            shutil.copy(journal, folder)
            path, mode = Path(shutil.copy(path, folder)), 'rw'
        address = f'{path.absolute().as_uri()}?mode={mode}'
        with closing(sqlite3.connect(address, uri=True)) as database:
            yield database
