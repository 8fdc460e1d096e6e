# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writing a map file: append-only, a transaction at a time."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
import sqlite3
from typing import Self

from convseq_ros.config import EncodingConfig, EVERY_FRAME, KeyframeConfig
from convseq_ros.core.encoding.global_descriptor import pooled
from convseq_ros.core.map.map_format import (
    about,
    checked_settings,
    encode_cells,
    picture_crc,
    place_crc,
    SCHEMA,
)
from convseq_ros.core.map.reference_map import Place, pose_numbers, unpack_cells
from convseq_ros.errors import MapError
import numpy as np
import numpy.typing as npt


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
        Add to an existing map, which must have been made with the same settings.
    keyframes : KeyframeConfig
        How far apart they are.

    Attributes
    ----------
    committed : int
        Places that are safe.

    Raises
    ------
    MapError
        If a new file exists already, or an existing one is missing, foreign, damaged or made
        with other settings; later, if the disk is full.

    """

    def __init__(
        self,
        path: Path,
        encoding: EncodingConfig,
        append: bool = False,
        keyframes: KeyframeConfig = EVERY_FRAME,
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
        self,
        place: Place,
        packed: npt.NDArray[np.float16],
        thumbnail: bytes = b'',
        first_sight: npt.NDArray[np.floating] | None = None,
    ) -> None:
        """Append a place; the parameters are those of `ReferenceMap.add`."""
        if first_sight is None:
            first_sight = pooled(unpack_cells(packed))
        index, sight = self._count, first_sight.astype('<f2').tobytes()
        # SQLite has no NaN and stores NULL, of which the checksum must tell the same.
        pose = [float(number) if number == number else None for number in pose_numbers(place.pose)]
        plain = index, place.stamp_ns, place.source, *pose
        cells = encode_cells(packed)
        with self._explained():
            marks = ', '.join('?' * (len(plain) + 2))
            values = (*plain, sight, place_crc(plain, sight))
            self._database.execute(f'INSERT INTO places VALUES ({marks})', values)
            picture = index, cells, thumbnail, picture_crc(index, cells, thumbnail)
            self._database.execute('INSERT INTO pictures VALUES (?, ?, ?, ?)', picture)
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


def _what_went_wrong(error: sqlite3.DatabaseError) -> str:
    code = getattr(error, 'sqlite_errorcode', 0) & 0xFF
    if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
        return f'damaged map ({error}); build it again'
    if code in (sqlite3.SQLITE_CONSTRAINT, sqlite3.SQLITE_BUSY):
        return f'another program adds to this map ({error}); let only one do so'
    if code == sqlite3.SQLITE_CANTOPEN:
        return f'cannot write ({error}); is it in a folder that exists and is writable?'
    return f'cannot write ({error}); is the disk full?'
