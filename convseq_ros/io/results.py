# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result table, with a row for every frame."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
import csv
from errno import EBUSY
import fcntl
from itertools import count
import os
from pathlib import Path
from threading import Thread
from typing import IO, Self

from convseq_ros.errors import SourceError
from convseq_ros.io.bell import Bell
from convseq_ros.io.regular_file import refuse_irregular, replace_safely, target_of

_SYNC_EVERY_S = 1.0  # rows of this time may be lost in a power failure


class ResultWriter:
    """
    Writes a result table row by row; use it as a context manager.

    `columns` are their names, such as those of `convseq_ros.core.result_row`. Rows are written to
    `<path>.part`, which `close` renames to `<path>`; a power failure may lose the rows of the last
    second. If an earlier run left rows behind, its file is renamed to `<path>.1.part`, or a higher
    number: `kept`. With `keeps_earlier` a complete table `a.csv` becomes `a.1.csv`, and so on.
    OSError if it cannot be written or is in use.
    """

    def __init__(self, path: Path, columns: Sequence[str], keeps_earlier: bool = False) -> None:
        self._keeps_earlier = keeps_earlier
        self._path, self.kept = (path := target_of(path)), None
        header = ','.join(columns) + '\n'
        self._part = path.with_name(path.name + '.part')
        self._file = self._opened('a')
        with self._part.open(encoding='utf-8', errors='replace') as file:
            has_rows = not header.startswith(file.read(len(header) + 1))
        if has_rows:
            self.kept = _free_name(self._part)
            os.rename(self._part, self.kept)
            self._file.close()
            self._file = self._opened('x')
        self._file.truncate(0)
        self._table = csv.DictWriter(self._file, columns, lineterminator='\n')
        self._file.write(header)
        self._written, self._end = Bell(), Bell()
        # A second handle, without the lock: the file may be closed during a sync.
        handle = os.open(self._part, os.O_RDONLY)
        Thread(target=_sync, args=(handle, self._written, self._end), daemon=True).start()

    def _opened(self, mode: str) -> IO[str]:
        """Return the part file, locked while it is open; a crash ends the lock, too."""
        file = self._part.open(mode, newline='', encoding='utf-8', buffering=1)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise OSError(EBUSY, 'another program writes it', str(self._part)) from None
        return file

    def write(self, row: Mapping[str, object]) -> None:
        """Append a row, by column; OSError, naming the part file, if the disk is full."""
        with self._named():
            self._table.writerow(row)
        self._written.ring()

    def close(self) -> None:
        """Give the table its name; OSError, naming the part file, if the disk is full."""
        if not self._file.closed:
            try:
                with self._named():
                    self._file.flush()
                    if self._keeps_earlier and self._path.exists():
                        os.rename(self._path, _free_name(self._path))
                    replace_safely(self._part, self._path)
            finally:
                self.abandon()

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            error.filename = str(self._part)
            raise

    def abandon(self) -> None:
        self._end.end()
        self._written.end()
        with suppress(OSError):
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, _error: object, _trace: object) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()


def _sync(handle: int, written: Bell, end: Bell) -> None:
    """Sync new rows to the disk, at most once a second, also if no row follows."""
    while written.wait():
        with suppress(OSError):
            os.fsync(handle)
        end.wait(_SYNC_EVERY_S)
    os.close(handle)


def _free_name(path: Path) -> Path:
    """Return the first name with a number before the ending that no file has."""
    names = (path.with_suffix(f'.{number}{path.suffix}') for number in count(1))
    return next(name for name in names if not name.exists())


def read_results(path: Path | str) -> list[dict[str, str]]:
    """Return the rows of a table, empty fields as empty texts; SourceError if it is no table."""
    path = Path(path)
    refuse_irregular(path)
    try:
        with path.open(newline='', encoding='utf-8') as file:
            return list(csv.DictReader(file))
    except (csv.Error, UnicodeDecodeError) as error:
        raise SourceError(f'{path}: not a result table ({error}); write it again') from None
