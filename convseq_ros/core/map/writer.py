# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writing a map file: append-only, a transaction at a time."""

from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
import json
import os
from pathlib import Path
import sqlite3
from typing import Self

from convseq_ros import __version__
from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.map.format import checked_settings, encode_cells, row_crc, SCHEMA
from convseq_ros.core.map.place import Picture, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.errors import MapError
import numpy as np
import numpy.typing as npt

_DAMAGED = 'damaged map ({}); build it again'
_ANOTHER = 'another program adds to this map ({}); let only one do so'
_WENT_WRONG = {  # by primary result code of SQLite
    sqlite3.SQLITE_NOTADB: _DAMAGED,
    sqlite3.SQLITE_CORRUPT: _DAMAGED,
    sqlite3.SQLITE_CONSTRAINT: _ANOTHER,
    sqlite3.SQLITE_BUSY: _ANOTHER,
    sqlite3.SQLITE_CANTOPEN: 'cannot write ({}); is it in a folder that exists and is writable?',
}


def save_map(reference_map: ReferenceMap, path: Path) -> None:
    """Write a map as it is now, replacing a file in one step, or, with a MapError, not at all."""
    part = path.with_name(path.name + '.part')
    try:
        part.unlink(missing_ok=True)
        with MapWriter(part, reference_map.encoding, reference_map.keyframes) as writer:
            writer.copy(reference_map, len(reference_map))
        os.replace(part, path)
    except (MapError, OSError) as error:
        part.unlink(missing_ok=True)
        raise MapError(f'{path}: cannot write the map ({error})') from error


def refuse_start(path: Path, append: bool) -> None:
    """Raise MapError if there is no file to append to, or one where a new one shall be."""
    if append and not path.is_file():
        raise MapError(f'{path}: no such map to append to')
    if not append and path.exists():
        raise MapError(f'{path}: exists already; append to it, or delete it first')


class MapWriter:
    """
    Appends places to a map file, a new one unless `append`; use it as a context manager.

    They are safe on disk after `commit`, which counts them in `committed`, and at the end, also
    when the work was interrupted. MapError if a new file exists already, or an existing one is
    missing, foreign, damaged or made with other settings; later, if the disk is full.
    """

    def __init__(
        self, path: Path, encoding: EncodingConfig, keyframes: KeyframeConfig, append: bool = False
    ) -> None:
        refuse_start(path, append)
        self._path = path
        with self._explained():
            self._database = sqlite3.connect(path, check_same_thread=False)
            try:
                if not append:
                    self._begin(encoding, keyframes)
                checked_settings(path, self._database, encoding, keyframes)
                count = 'SELECT coalesce(max(reference_index), -1) + 1 FROM places'
                self._count = self.committed = self._database.execute(count).fetchone()[0]
            except BaseException:
                self._database.close()
                raise

    def add(
        self, place: Place, picture: Picture, global_descriptor: npt.NDArray[np.float16]
    ) -> None:
        """Append a place; its global descriptor has shape (n,)."""
        index, descriptor = self._count, global_descriptor.astype('<f2').tobytes()
        plain = index, place.stamp_ns, place.source, *place.pose_numbers
        cells, small = encode_cells(picture.packed), picture.thumbnail
        rows = {
            'places': (*plain, descriptor, row_crc(plain, descriptor)),
            'pictures': (index, cells, small, row_crc(index, cells, small)),
        }
        with self._explained():
            for table, row in rows.items():
                marks = ', '.join('?' * len(row))
                self._database.execute(f'INSERT INTO {table} VALUES ({marks})', row)
        self._count += 1

    def copy(self, reference_map: ReferenceMap, end: int) -> None:
        """Append and commit the places of a map that are not here yet, up to before `end`."""
        try:
            for index in range(self._count, end):
                place, (picture,) = reference_map.places[index], reference_map.pictures([index])
                self.add(place, picture, reference_map.global_descriptors[index])
            self.commit()
        except MapError:
            with suppress(sqlite3.DatabaseError):
                self._database.rollback()
                self._count = self.committed
            raise

    def commit(self) -> None:
        """Make what was added safe."""
        with self._explained():
            self._database.commit()
        self.committed = self._count

    def close(self) -> None:
        """Close the file without a commit."""
        self._database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: object, _trace: object) -> None:
        with closing(self._database):
            if not isinstance(error, MapError):
                self.commit()

    def _begin(self, encoding: EncodingConfig, keyframes: KeyframeConfig) -> None:
        self._database.executescript(SCHEMA)
        about = {
            'encoding': json.dumps({'image_size_px': encoding.image_size_px}),
            'keyframes': json.dumps(keyframes.spacing),
            'tool': __version__,
        }
        self._database.executemany('INSERT INTO about VALUES (?, ?)', about.items())
        self._database.commit()

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.DatabaseError as error:
            code = getattr(error, 'sqlite_errorcode', 0) & 0xFF
            words = _WENT_WRONG.get(code, 'cannot write ({}); is the disk full?')
            raise MapError(f'{self._path}: {words.format(error)}') from error
