# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writing a map file: append-only, a transaction at a time."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
import os
from pathlib import Path
import sqlite3
from typing import Self

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.map.format import (
    about,
    checked_settings,
    encode_cells,
    picture_crc,
    place_crc,
    SCHEMA,
)
from convseq_ros.core.map.place import Picture, Place, pose_numbers
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.errors import MapError
import numpy as np
import numpy.typing as npt


def save_map(reference_map: ReferenceMap, path: Path) -> None:
    """
    Write a map as it is now, replacing the file in one step.

    MapError if it cannot be written; an existing file is then unchanged.
    """
    part = path.with_name(path.name + '.part')
    try:
        part.unlink(missing_ok=True)
        with MapWriter(part, reference_map.encoding, reference_map.keyframes) as writer:
            copy_places(reference_map, writer, len(reference_map))
        os.replace(part, path)
    except (MapError, OSError) as error:
        part.unlink(missing_ok=True)
        raise MapError(f'{path}: cannot write the map ({error})') from error


class MapWriter:
    """
    Appends places to a map file; use it as a context manager.

    Places are safe on disk after `commit`, and at the end, also when the work was interrupted;
    `committed` counts them. A new file is made unless `append`; then it must have been made with
    the same settings.

    Raises
    ------
    MapError
        If a new file exists already, or an existing one is missing, foreign, damaged or made
        with other settings; later, if the disk is full.

    """

    def __init__(
        self, path: Path, encoding: EncodingConfig, keyframes: KeyframeConfig, append: bool = False
    ) -> None:
        self.encoding = encoding
        self._keyframes = keyframes
        self._path = path
        if append and not path.is_file():
            raise MapError(f'{path}: no such map to append to')
        if not append and path.exists():
            raise MapError(f'{path}: exists already; append to it, or delete it first')
        with self._explained():
            self._database = sqlite3.connect(path, check_same_thread=False)
            try:
                if append:
                    checked_settings(path, self._database, encoding, keyframes)
                else:
                    self._begin()
                last = 'SELECT coalesce(max(reference_index), -1) FROM places'
                self._count = self.committed = self._database.execute(last).fetchone()[0] + 1
            except BaseException:
                self._database.close()
                raise

    def add(
        self, place: Place, picture: Picture, global_descriptor: npt.NDArray[np.float16]
    ) -> None:
        """Append a place; its global descriptor has shape (n,)."""
        index, descriptor = self._count, global_descriptor.astype('<f2').tobytes()
        # SQLite has no NaN and stores NULL, of which the checksum must tell the same.
        pose = [float(number) if number == number else None for number in pose_numbers(place.pose)]
        plain = index, place.stamp_ns, place.source, *pose
        cells = encode_cells(picture.packed)
        with self._explained():
            marks = ', '.join('?' * (len(plain) + 2))
            values = (*plain, descriptor, place_crc(plain, descriptor))
            self._database.execute(f'INSERT INTO places VALUES ({marks})', values)
            crc = picture_crc(index, cells, picture.thumbnail)
            values = index, cells, picture.thumbnail, crc
            self._database.execute('INSERT INTO pictures VALUES (?, ?, ?, ?)', values)
        self._count += 1

    def commit(self) -> None:
        """Make what was added safe."""
        with self._explained():
            self._database.commit()
        self.committed = self._count

    def roll_back(self) -> None:
        """Forget what was added since the last commit."""
        with self._explained():
            self._database.rollback()
        self._count = self.committed

    def close(self) -> None:
        """Close the file without a commit."""
        self._database.close()

    def __len__(self) -> int:
        return self._count

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: object, _trace: object) -> None:
        with closing(self._database):
            if not isinstance(error, MapError):
                self.commit()

    def _begin(self) -> None:
        self._database.executescript(SCHEMA)
        facts = about(self.encoding, self._keyframes)
        self._database.executemany('INSERT INTO about VALUES (?, ?)', facts.items())
        self._database.commit()

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.DatabaseError as error:
            raise MapError(f'{self._path}: {_what_went_wrong(error)}') from error


def copy_places(reference_map: ReferenceMap, writer: MapWriter, end: int) -> None:
    """Write the places that follow those that a writer has, up to before `end`."""
    for index in range(len(writer), end):
        known = reference_map.global_descriptors[index]
        writer.add(reference_map.place(index), reference_map.picture(index), known)


def _what_went_wrong(error: sqlite3.DatabaseError) -> str:
    code = getattr(error, 'sqlite_errorcode', 0) & 0xFF
    if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
        return f'damaged map ({error}); build it again'
    if code in (sqlite3.SQLITE_CONSTRAINT, sqlite3.SQLITE_BUSY):
        return f'another program adds to this map ({error}); let only one do so'
    if code == sqlite3.SQLITE_CANTOPEN:
        return f'cannot write ({error}); is it in a folder that exists and is writable?'
    return f'cannot write ({error}); is the disk full?'
