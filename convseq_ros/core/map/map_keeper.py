# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A growing map, kept in its file as it grows."""

from contextlib import closing, suppress
import os
from pathlib import Path
from threading import Lock
import time

from convseq_ros.core.map.map_file import copy_places
from convseq_ros.core.map.map_reader import MapReader
from convseq_ros.core.map.map_writer import MapWriter
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.errors import MapError
import numpy as np

_COMMIT_EVERY_NS = 500_000_000
_PLACES_AT_ONCE = 500


class MapKeeper:
    """
    Writes what is added to a map to a file; one thread at a time does so.

    What is safe in the file is read from there when it is needed, so that a map that grows all day
    does not fill the memory. What was committed outlives a crash.

    Parameters
    ----------
    path : Path
        The file: a new one, to which all places are written at once, or the one that the map was
        opened from, which is appended to.
    reference_map : ReferenceMap
        The map.

    Raises
    ------
    MapError
        If the file cannot be written, or holds another map.

    """

    def __init__(self, path: Path, reference_map: ReferenceMap) -> None:
        _refuse_read_only(path)
        self._path = path
        self._map = reference_map
        self._writer = MapWriter(
            path, reference_map.encoding, path.exists(), reference_map.keyframes
        )
        self._lock = Lock()
        self._committed_ns: int | None = None
        self._has_failed = False
        try:
            self._pictures = MapReader(path)
            if self._writer.committed:
                self._refuse_other_map()
            self._file = path.stat().st_ino
            self._write()
        except BaseException:
            self._writer.close()
            raise

    @property
    def committed(self) -> int:
        """Places that are safe in the file."""
        return self._writer.committed

    def keep(self, now_ns: int | None = None) -> None:
        """
        Write what was added, and every half a second make it safe.

        Parameters
        ----------
        now_ns : int, optional
            The time of a clock that does not jump; by default that of the machine.

        Raises
        ------
        MapError
            If it cannot be written, once; later calls try again and say nothing before they
            succeed. The map goes on in memory.

        """
        now_ns = time.monotonic_ns() if now_ns is None else now_ns
        with self._lock:
            last_ns = self._committed_ns
            if last_ns is not None and now_ns - last_ns < _COMMIT_EVERY_NS:
                return
            self._committed_ns = now_ns
            try:
                self._write()
            except MapError:
                if not self._has_failed:
                    self._has_failed = True
                    raise
            else:
                self._has_failed = False

    def close(self) -> None:
        """
        Make all that was added safe and close the file.

        Raises
        ------
        MapError
            If it cannot be written.

        """
        with self._lock, closing(self._writer):
            self._write()

    def _write(self) -> None:
        end = len(self._map)
        try:
            while self._writer.committed < end:
                self._refuse_replaced()
                stop = min(end, self._writer.committed + _PLACES_AT_ONCE)
                copy_places(self._map, self._writer, stop)
                self._writer.commit()
                self._map.let_go(stop, self._pictures)
        except MapError:
            with suppress(MapError):
                self._writer.roll_back()
            raise

    def _refuse_other_map(self) -> None:
        last = self._writer.committed - 1
        if last >= len(self._map) or not np.array_equal(
            self._pictures.pictures([last])[0].packed, self._map.packed(last)
        ):
            raise MapError(
                f'{self._path}: holds another map than the one that grows; open that one first, '
                'or name a new file'
            )

    def _refuse_replaced(self) -> None:
        try:
            same = self._path.stat().st_ino == self._file
        except OSError:
            same = False
        if not same:
            raise MapError(f'{self._path}: was moved or replaced; what is added is not kept')


def _refuse_read_only(path: Path) -> None:
    """Say at the start what would else go wrong later; SQLite needs the folder for its journal."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise MapError(f'{path}: there is no folder {folder}; make it')
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise MapError(
            f'{path}: cannot be written; make it and its folder writable, or copy it elsewhere'
        )
