# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading a map file: the places' numbers at once, pictures on demand."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
import math
from pathlib import Path
import sqlite3
from threading import Lock
from typing import Any
import weakref

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.config.config import MOST_KEYPOINTS
from convseq_ros.core.encoding.descriptor import cell_shape
from convseq_ros.core.encoding.first_stage import vector_length
from convseq_ros.core.encoding.keypoints import BYTES
from convseq_ros.core.encoding.mask import without_path
from convseq_ros.core.graph.links import Links
from convseq_ros.core.graph.trail import Keyframe, Trail
from convseq_ros.core.map.arrays import Places
from convseq_ros.core.map.crash_recovery import open_to_read
from convseq_ros.core.map.database import as_map_error, Database, Rows
from convseq_ros.core.map.format import (
    checked_pose,
    decode_cells,
    keyframe_of,
    MapSession,
    row_crc,
    Settings,
)
from convseq_ros.core.map.place import Picture
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.errors import MapError

_ROWS_AT_ONCE = 2048  # rows of `places` in a query, some MB of memory
_BYTES_A_NUMBER = 2  # of the cells
_LINKS_AT_ONCE = 8192  # rows in a query, some MB of memory
_PICTURES_AT_ONCE = 64  # in a query; with images, some 20 MB


def open_map(
    path: str | Path,
    encoding: EncodingConfig | None = None,
    keyframes: KeyframeConfig | None = None,
) -> ReferenceMap:
    """
    Open a map file; it is not changed, and must stay in place while the map is used.

    Parameters
    ----------
    path : str or Path
        The map. What a crash left beside it is read, too.
    encoding : EncodingConfig, optional
        How queries are encoded; by default as the map's places.
    keyframes : KeyframeConfig, optional
        Spacing of places to add; by default that of the map.

    Returns
    -------
    ReferenceMap
        The places; their cells and thumbnails are read and checked on demand.

    Raises
    ------
    MapError
        If the file is missing, foreign, damaged, of another format or made with other settings.

    """
    return MapReader(Path(path), encoding, keyframes).reference_map()


def map_id_of(path: Path) -> str:
    """Return the id of a map file, whose places are not read; MapError as for `open_map`."""
    return MapReader(path).settings.map_id


class MapReader:
    """
    A map file that is open for reading, for `open_map` and `Appender`; any thread may read.

    The file is not changed. If a crash left it with a journal, a repaired copy is read. `encoding`
    is that of the queries, `keyframes` the spacing of places to add; both default to the map's.
    MapError if the file is missing, foreign, damaged, of another format or made with other
    settings; reading on demand raises it if that part is damaged.
    """

    def __init__(
        self,
        path: Path,
        encoding: EncodingConfig | None = None,
        keyframes: KeyframeConfig | None = None,
    ) -> None:
        self._path, self._lock = path, Lock()
        self.take_as_it_is()
        with as_map_error(path):
            self._open()
            self._database.check(path)
            self._about = {name: value for name, value, _ in self._database.checked('about')}
            if any(type(text) is not str for row in self._about.items() for text in row):
                raise ValueError('settings: not text')
            self.settings = Settings.from_rows(self._about)
        stored = self.settings.encoding
        requested = without_path(encoding or stored)
        if reason := self.settings.mismatch(requested, keyframes):
            raise MapError(f'{path}: {reason}')
        self.encoding = replace(requested, image_mask=stored.image_mask)
        self.keyframes = keyframes or self.settings.keyframes
        self._cell_shape = cell_shape(self.encoding.image_size_px)

    def _open(self) -> None:
        self._database = open_to_read(self._path)
        # Not at exit: another thread may still read then, and a reader need not close the file.
        weakref.finalize(self, self._database.close).atexit = False

    @contextmanager
    def released(self) -> Iterator[None]:
        """Close the file for a block that changes its journal mode; readers wait."""
        with as_map_error(self._path), self._lock:
            self._database.close()
            try:
                yield
            finally:
                self._open()

    def __len__(self) -> int:
        with self._snapshot():
            return self._end()

    def about(self) -> dict[str, Any]:
        """Return the rows of `about`, and the numbers of thumbnails, keypoints and images."""
        names = 'thumbnails', 'keypoints', 'keypoint_bytes', 'images', 'image_bytes'
        counts = dict.fromkeys(names, 0)
        with self._snapshot():
            for start in range(0, self._end(), _ROWS_AT_ONCE):
                block = f'WHERE reference_index BETWEEN {start} AND {start + _ROWS_AT_ONCE - 1}'
                for name, query in (
                    ('thumbnails', 'count(nullif(length(thumbnail), 0)) FROM pictures'),
                    ('keypoints', 'count(nullif(length(keypoints), 0)) FROM pictures'),
                    ('keypoint_bytes', 'coalesce(sum(length(keypoints)), 0) FROM pictures'),
                    ('images', 'count(jpeg) FROM images'),
                    ('image_bytes', 'coalesce(sum(length(jpeg)), 0) FROM images'),
                ):
                    counts[name] += self._database.number(f'SELECT {query} {block}')
        return {**self._about, **counts}

    def _sessions(self) -> list[MapSession]:
        rows = self._database.checked('sessions')
        if [row[0] for row in rows] != [*range(len(rows))]:
            raise ValueError('a session is missing')
        return [MapSession.from_row(row[1:-1]) for row in rows]

    def reference_map(self) -> ReferenceMap:
        """Return the map; the numbers of its places and its links are read and checked now."""
        with self._snapshot():
            sessions = self._sessions()
            places = Places(vector_length(self.encoding), self._end())
            kept = 'SELECT 1 FROM images WHERE jpeg IS NOT NULL LIMIT 1'
            keeps_images = bool(self._database.rows(kept))
            block = 'WHERE reference_index >= ? ORDER BY reference_index LIMIT ?'
            while rows := self._database.checked('places', block, (len(places), _ROWS_AT_ONCE)):
                start, numbers = len(places), [row[-3] for row in rows]
                expected = range(start, start + len(rows))
                if missing := [*{*expected}.difference(row[0] for row in rows)]:
                    raise ValueError(f'reference {min(missing)} is missing')
                if foreign := [row[0] for row in rows if not 0 <= row[-3] < len(sessions)]:
                    raise ValueError(f'reference {foreign[0]} belongs to no session')
                numbers = [places[start - 1].session, *numbers] if start else numbers
                if numbers != sorted(numbers):
                    raise ValueError('places of a session are not adjacent')
                places.extend(self._with_vectors(rows))
            links = Links(places.bounds.around)
            problem = _read_links(self._database, self._path, len(places), links)
            trail = Trail(self._keyframes, self._trail_end())
        settings = self.encoding, places, self.pictures, self.keyframes, self.settings.map_id
        opened = ReferenceMap(*settings, sessions, links, problem, keeps_images, trail)
        opened.position_sigma_m = self.settings.position_sigma_m
        return opened

    def _trail_end(self) -> int:
        """Return the number of the next keyframe; 0 if the table is damaged."""
        try:
            return self._database.number('SELECT coalesce(max(number), -1) + 1 FROM keyframes')
        except sqlite3.DatabaseError:
            self._database.roll_back()
            return 0

    def _keyframes(self) -> list[Keyframe]:
        """Return the keyframes of the drives with odometry, without those that are damaged."""
        found, start = list[Keyframe](), 0
        query = 'SELECT * FROM keyframes WHERE number >= ? ORDER BY number LIMIT ?'
        with self._snapshot():
            try:
                while rows := self._database.rows(query, (start, _LINKS_AT_ONCE)):
                    if rows[0][0] < start:
                        break  # a damaged page leads to others, perhaps in a circle
                    start = rows[-1][0] + 1
                    for *row, crc32 in rows:
                        with suppress(TypeError, ValueError, OverflowError):
                            if crc32 == row_crc((*row,)):
                                found.append(keyframe_of((*row[1:],)))
            except sqlite3.DatabaseError:
                self._database.roll_back()  # what was read before is valid
        return found

    def _with_vectors(self, rows: Rows) -> Rows:
        """Return rows of `places`, with the model's vectors as descriptors if they are used."""
        if not self.encoding.descriptor_model:
            return rows
        first, last = rows[0][0], rows[-1][0]
        vectors = self._database.checked(
            'vectors', 'WHERE reference_index BETWEEN ? AND ?', (first, last)
        )
        if [row[0] for row in vectors] != [row[0] for row in rows]:
            raise ValueError(f'a vector of references {first} to {last} is missing')
        return [(*row[:-2], vector[1], row[-1]) for row, vector in zip(rows, vectors, strict=True)]

    def pictures(self, indices: Sequence[int], with_images: bool = False) -> list[Picture]:
        """Return the checked pictures of places in the order of `indices`, images if wanted."""
        # One transaction for all: most of the time of a read is spent on the file's lock.
        wanted, pictures = [*dict.fromkeys(indices)], dict[int, Picture]()
        with self._snapshot():
            for start in range(0, len(wanted), _PICTURES_AT_ONCE):
                block = wanted[start : start + _PICTURES_AT_ONCE]
                stored = self._of_places('pictures', block)
                images = self._of_places('images', block) if with_images else {}
                for index in block:
                    cells, thumbnail, keypoints = stored[index]
                    (image,) = images.get(index, (None,))
                    blobs = thumbnail, keypoints, b'' if image is None else image
                    are_bytes = all(isinstance(blob, bytes) for blob in blobs)
                    if not are_bytes or len(keypoints) > MOST_KEYPOINTS * BYTES:
                        raise ValueError(f'the thumbnail, keypoints or image of reference {index}')
                    packed = decode_cells(cells, self._cell_shape)
                    pictures[index] = Picture(packed, thumbnail, keypoints, image)
        return [pictures[index] for index in indices]

    def _of_places(self, table: str, indices: list[int]) -> dict[int, tuple[Any, ...]]:
        """Return rows of a table by index; ValueError if one is missing."""
        where = f'WHERE reference_index IN ({", ".join("?" * len(indices))})'
        rows = {row[0]: row[1:-1] for row in self._database.checked(table, where, tuple(indices))}
        if missing := [index for index in indices if index not in rows]:
            raise ValueError(f'reference {missing[0]} is missing')
        return rows

    def _end(self) -> int:
        """Return the number of places; ValueError if a table or the file is too small for it."""
        end_of = '(SELECT coalesce(max(reference_index), -1) + 1 FROM {})'
        ends = ', '.join(end_of.format(table) for table in ('places', 'pictures', 'images'))
        ((end, *others),) = self._database.rows(f'SELECT {ends}')
        if others != [end, end]:
            raise ValueError(f'reference {min(end, *others)} is missing')
        pages, page_bytes = map(self._database.number, ('PRAGMA page_count', 'PRAGMA page_size'))
        size = pages * page_bytes
        if end * math.prod(self._cell_shape) * _BYTES_A_NUMBER > size:
            raise ValueError(f'{end} places in {size} bytes')
        return int(end)

    @contextmanager
    def _snapshot(self) -> Iterator[None]:
        with as_map_error(self._path), self._lock:
            self._refuse_other()
            with self._database.transaction():
                yield

    def take_as_it_is(self) -> None:
        """Remember the state of the file, after its owner wrote to it."""
        self._state = _state_of(self._path)

    def _refuse_other(self) -> None:
        """Raise a MapError if another map was copied over the file; SQLite may not notice."""
        now = _state_of(self._path)
        is_same_file = now and self._state and now[0] == self._state[0]
        if is_same_file and now != self._state:
            if map_id_of(self._path) != self.settings.map_id:
                raise MapError(f'{self._path}: was overwritten by another map; load it again')
            self._state = now


def _state_of(path: Path) -> tuple[int, int, int] | None:
    """Return the number, the size and the time of the last change of a file, if it is there."""
    with suppress(OSError):
        status = path.stat()
        return status.st_ino, status.st_size, status.st_mtime_ns
    return None


def _read_links(database: Database, path: Path, count: int, links: Links) -> str:
    """Add the stored links of `count` places; damaged ones are left out, and named in a line."""
    start, found, damaged = 0, 0, 0
    query = f'SELECT * FROM links WHERE place >= ? AND place < {count} ORDER BY place LIMIT ?'
    try:
        while rows := database.rows(query, (start, _LINKS_AT_ONCE)):
            places = [row[0] for row in rows]
            if places[0] < start or places != sorted({*places}):
                raise sqlite3.DatabaseError('a damaged page leads to others, perhaps in a circle')
            damaged += _add_links(links, rows)
            found += len(rows)
            start = places[-1] + 1
        # A row may not be found by its place: of a place that is not there, or out of order.
        left_out = damaged + database.number('SELECT count(*) FROM links') - found
    except sqlite3.DatabaseError:
        database.roll_back()  # the links that were read before are valid
        problem = f'the links of places from {start} on are damaged'
    else:
        problem = f'{left_out} links are damaged' if left_out else ''
    return problem and f'{path}: {problem} and left out; all the rest works'


def _add_links(links: Links, rows: Rows) -> int:
    """Add the links of stored rows in order; return how many rows are damaged."""
    damaged = 0
    for place, other, anchor, confidence, inliers, relative, crc32 in rows:
        try:
            if crc32 != row_crc((place, other, anchor, confidence, inliers, relative)):
                raise ValueError('a link fails its checksum')
            if other is None:
                mark = links.add_first if confidence is None else links.add_unlinked
                mark(place)
                continue
            are_integers = all(type(value) is int for value in (other, anchor, inliers or 0))
            if not are_integers or not 0 <= anchor <= other or not 0 <= (confidence or 0) <= 1:
                raise ValueError('invalid link')
            pose = None if relative is None else checked_pose(relative)
            links.add(place, other, confidence, inliers, pose, anchor)
        except (TypeError, ValueError):
            damaged += 1
    return damaged
