# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading a map file: what is held in memory at once, and the rest on demand."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
import math
from pathlib import Path
import sqlite3
from threading import Lock
from typing import Any
import weakref

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.encoding.descriptor import cell_shape
from convseq_ros.core.encoding.first_stage import vector_length
from convseq_ros.core.encoding.view import with_mask_read
from convseq_ros.core.graph.links import Links
from convseq_ros.core.map.crash_recovery import open_to_read
from convseq_ros.core.map.database import Database, explained, Rows
from convseq_ros.core.map.format import decode_cells, MapSession, row_crc, Settings, unpacked_pose
from convseq_ros.core.map.place import NO_CELLS, Picture, Places
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.errors import MapError

_ROWS_AT_ONCE = 2048  # of `places`, for some MB of memory
_BYTES_A_NUMBER = 2  # of the cells
_LINKS_AT_ONCE = 8192  # rows, for some MB of memory
_PICTURES_AT_ONCE = 64  # for a statement; with images, some 20 MB


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
    return MapReader(Path(path), encoding, keyframes).reference_map()


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
        with explained(path):
            self._open()
            self._database.check(path)
            self._about = {name: value for name, value, _ in self._database.sound('about')}
            self.settings = Settings.of_rows(self._about)
        own = self.settings.encoding
        asked = with_mask_read(encoding or own)
        if reason := self.settings.refused(asked, keyframes):
            raise MapError(f'{path}: {reason}')
        self.encoding = replace(
            asked, resize=own.resize, image_mask=own.image_mask, keeps_cells=own.keeps_cells
        )
        self.keyframes = keyframes or self.settings.keyframes
        self._cell_shape = cell_shape(self.encoding.image_size_px)

    def _open(self) -> None:
        self._database = open_to_read(self._path)
        # A thread may still read when the process ends; what is only read needs no closing.
        weakref.finalize(self, self._database.close).atexit = False

    @contextmanager
    def released(self) -> Iterator[None]:
        """Let go of the file, so that it may be kept in another way; who reads waits."""
        with explained(self._path), self._lock:
            self._database.close()
            try:
                yield
            finally:
                self._open()

    def __len__(self) -> int:
        with self._at_one_moment():
            return self._end()

    def about(self) -> dict[str, Any]:
        """Return what the file says about itself, and what pictures it holds."""
        found = {'thumbnails': 0, 'images': 0, 'image_bytes': 0, 'depths': 0}
        with self._at_one_moment():
            for start in range(0, self._end(), _ROWS_AT_ONCE):
                some = f'WHERE reference_index BETWEEN {start} AND {start + _ROWS_AT_ONCE - 1}'
                for name, what in (
                    ('thumbnails', 'count(nullif(length(thumbnail), 0)) FROM pictures'),
                    ('images', 'count(jpeg) FROM images'),
                    ('image_bytes', 'coalesce(sum(length(jpeg)), 0) FROM images'),
                ):
                    found[name] += self._database.number(f'SELECT {what} {some}')
            found['depths'] = self._database.number('SELECT count(*) FROM depths')
        return {**self._about, **found}

    def reference_map(self) -> ReferenceMap:
        """Return the map, with what is held in memory of its places, checked."""
        with self._at_one_moment():
            rows = self._database.sound('sessions')
            sessions = [MapSession.of_row(row[1:-1]) for row in rows]
            if [row[0] for row in rows] != [*range(len(rows))]:
                raise ValueError('a session is missing')
            places = Places(vector_length(self.encoding), self._end())
            kept = 'depths', 'images WHERE jpeg IS NOT NULL'
            keeps_images = any(self._database.rows(f'SELECT 1 FROM {one} LIMIT 1') for one in kept)
            next_ones = 'WHERE reference_index >= ? ORDER BY reference_index LIMIT ?'
            while rows := self._database.sound('places', next_ones, (len(places), _ROWS_AT_ONCE)):
                start, of = len(places), [row[-3] for row in rows]
                expected = range(start, start + len(rows))
                if missing := [*{*expected}.difference(row[0] for row in rows)]:
                    raise ValueError(f'reference {min(missing)} is missing')
                if foreign := [row[0] for row in rows if not 0 <= row[-3] < len(sessions)]:
                    raise ValueError(f'reference {foreign[0]} is of no session')
                of = [places[start - 1].session, *of] if start else of
                if of != sorted(of):
                    raise ValueError('places of one session lie apart')
                places.extend(self._with_vectors(rows))
            settings = self.encoding, places, self.pictures, self.keyframes
            made = ReferenceMap(*settings, self.settings.map_id, sessions)
            made.keeps_images = keeps_images
            _read_links(self._database, self._path, made)
        return made

    def _with_vectors(self, rows: Rows) -> Rows:
        """Return rows of `places` in order, with the model's vectors, if these are asked for."""
        if not (self.encoding.descriptor_model and self.encoding.keeps_cells):
            return rows
        first, last = rows[0][0], rows[-1][0]
        vectors = self._database.sound(
            'vectors', 'WHERE reference_index BETWEEN ? AND ?', (first, last)
        )
        if [row[0] for row in vectors] != [row[0] for row in rows]:
            raise ValueError(f'a vector of references {first} to {last} is missing')
        return [(*row[:-2], own[1], row[-1]) for row, own in zip(rows, vectors, strict=True)]

    def pictures(self, indices: Sequence[int], with_images: bool = False) -> list[Picture]:
        """Return what is large of places, in the order asked for, checked; images if wanted."""
        # One transaction for many: what a read costs is mostly the lock on the file.
        wanted, found = [*dict.fromkeys(indices)], dict[int, Picture]()
        with self._at_one_moment():
            for start in range(0, len(wanted), _PICTURES_AT_ONCE):
                some = wanted[start : start + _PICTURES_AT_ONCE]
                stored = self._of_places('pictures', some)
                images = self._of_places('images', some) if with_images else {}
                depths = self._of_places('depths', some, are_all=False) if with_images else {}
                for index in some:
                    cells, thumbnail = stored[index]
                    packed = NO_CELLS
                    if self.encoding.keeps_cells:
                        packed = decode_cells(cells, self._cell_shape)
                    beside = *images.get(index, (None,)), *depths.get(index, (None,))
                    found[index] = Picture(packed, thumbnail, *beside)
        return [found[index] for index in indices]

    def _of_places(
        self, table: str, indices: list[int], are_all: bool = True
    ) -> dict[int, tuple[Any, ...]]:
        some = f'WHERE reference_index IN ({", ".join("?" * len(indices))})'
        found = {row[0]: row[1:-1] for row in self._database.sound(table, some, tuple(indices))}
        if are_all and (missing := [index for index in indices if index not in found]):
            raise ValueError(f'reference {missing[0]} is missing')
        return found

    def _end(self) -> int:
        """Return the number of places; ValueError if a table, or the file's size, says less."""
        last = '(SELECT coalesce(max(reference_index), -1) + 1 FROM {})'
        all_ends = ', '.join(last.format(table) for table in ('places', 'pictures', 'images'))
        ((end, *others),) = self._database.rows(f'SELECT {all_ends}')
        if others != [end, end]:
            raise ValueError(f'reference {min(end, *others)} is missing')
        pages, page_bytes = map(self._database.number, ('PRAGMA page_count', 'PRAGMA page_size'))
        size = pages * page_bytes
        kept = self.encoding.keeps_cells
        bytes_each = math.prod(self._cell_shape) * _BYTES_A_NUMBER if kept else 1
        if end * bytes_each > size:
            raise ValueError(f'{end} places in {size} bytes')
        return int(end)

    @contextmanager
    def _at_one_moment(self) -> Iterator[None]:
        with explained(self._path), self._lock, self._database.transaction():
            yield


def _read_links(database: Database, path: Path, reference_map: ReferenceMap) -> None:
    """Add its links to a map; its `problem` says how many are damaged, and left out."""
    start, count = 0, len(reference_map)
    off = f'SELECT count(*) FROM links WHERE place < 0 OR place >= {count}'
    asked = f'SELECT * FROM links WHERE place >= ? AND place < {count} ORDER BY place LIMIT ?'
    try:
        left_out = database.number(off)
        while rows := database.rows(asked, (start, _LINKS_AT_ONCE)):
            places = [row[0] for row in rows]
            if places[0] < start or places != sorted({*places}):
                raise sqlite3.DatabaseError('a damaged page leads to others, perhaps in a circle')
            left_out += _add_links(reference_map.links, rows)
            start = places[-1] + 1
    except sqlite3.DatabaseError:
        database.roll_back()  # what was read before is sound
        problem = f'the links of places from {start} on are damaged'
    else:
        problem = f'{left_out} links are damaged' if left_out else ''
    if problem:
        reference_map.problem = f'{path}: {problem} and left out; all else works'


def _add_links(links: Links, rows: Rows) -> int:
    """Add links of stored rows, in order; return how many are damaged."""
    damaged = 0
    for place, other, anchor, confidence, inliers, relative, crc32 in rows:
        try:
            if crc32 != row_crc((place, other, anchor, confidence, inliers, relative)):
                raise ValueError('a link that fails its checksum')
            if other is None:
                links.add_first(place)
                continue
            whole = all(type(one) is int for one in (other, anchor, inliers or 0))
            if not whole or not 0 <= anchor <= other or not 0 <= (confidence or 0) <= 1:
                raise ValueError('a link that cannot be')
            measured = None if relative is None else unpacked_pose(relative)
            links.add(place, other, confidence, inliers, measured, anchor)
        except (TypeError, ValueError):
            damaged += 1
    return damaged
