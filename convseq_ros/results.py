# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result table, with a row for every frame."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import csv
from errno import EBUSY
import fcntl
from itertools import count
import os
from pathlib import Path
from threading import Event, Thread
from typing import IO, Self

from convseq_ros.core.types import Match, Reason, RelativePose, Status
from convseq_ros.errors import SourceError
from convseq_ros.regular_file import refuse_irregular, replace_safely

_SYNC_EVERY_S = 1.0  # rows of this time may be lost in a power failure


def row(match: Match, duration_ms: float) -> dict[str, object]:
    """Return the row of a match; None, an empty field, for a value that is missing."""
    accepted, best, localization = match.accepted, match.best, match.localization
    shift = best.shift if best and best.shift else (None, None)
    rows_px, cols_px = match.shift_px or (None, None)
    return {
        'query_index': match.query_index,
        'query_stamp_ns': match.query_stamp_ns,
        'status': match.status.value,
        'reason': match.reason.value,
        'reference_index': accepted.reference_index if accepted else None,
        'reference_stamp_ns': accepted.reference_stamp_ns if accepted else None,
        'score': f'{accepted.score:.7f}' if accepted else None,
        'confidence': _decimals(match.confidence, 4),
        'sequence_length': match.sequence_length,
        'best_index': best.reference_index if best else None,
        'best_score': f'{best.score:.7f}' if best else None,
        'shift_rows': shift[0],
        'shift_cols': shift[1],
        'pairs_scored': match.pairs_scored,
        'duration_ms': f'{duration_ms:.3f}',
        'shift_rows_px': _decimals(rows_px, 1),
        'shift_cols_px': _decimals(cols_px, 1),
        'relative_yaw_rad': _decimals(match.relative_yaw_rad, 5),
        'inliers': best.inliers if best else None,
        'localization': localization.state.value if localization else None,
        'localization_quality': _decimals(localization.quality, 4) if localization else None,
        **_relative(match.relative_pose),
        'implausible_m': _decimals(match.implausible_m, 2),
        'session': best.session if best else None,
        'camera': match.camera or None,
        'anchor_session': match.anchor.session_id if match.anchor else None,
        'anchor_stamp_ns': match.anchor.stamp_ns if match.anchor else None,
    }


def _relative(pose: RelativePose | None) -> dict[str, str | None]:
    position: tuple[float | None, ...] = (pose and pose.position_m) or (None,) * 3
    turn: tuple[float | None, ...] = pose.orientation if pose else (None,) * 4
    values = [_decimals(x, 4) for x in position] + [_decimals(x, 6) for x in turn]
    names = [f'{axis}_m' for axis in 'xyz'] + [f'q{axis}' for axis in 'xyzw']
    return {
        **{f'relative_{name}': value for name, value in zip(names, values, strict=True)},
        'position_sigma_m': _decimals(pose.position_sigma_m, 4) if pose else None,
        'heading_sigma_rad': _decimals(pose.heading_sigma_rad, 5) if pose else None,
    }


def _decimals(value: float | None, count: int) -> str | None:
    return None if value is None else f'{value:.{count}f}'


COLUMNS = tuple(row(Match(0, 0, Status.SKIPPED, Reason.WEAK), 0.0))
_HEADER = ','.join(COLUMNS) + '\n'


class ResultWriter:
    """
    Writes a result table row by row; use it as a context manager.

    Rows are written to `<path>.part`, which `close` renames to `<path>`; a power failure may lose
    the rows of the last second. If an earlier run left rows behind, its file is renamed to
    `<path>.1.part`, or a higher number: `kept`. OSError if it cannot be written or is in use.
    """

    def __init__(self, path: Path) -> None:
        self._path, self.kept = path, None
        self._part = path.with_name(path.name + '.part')
        self._file = self._opened('a')
        with self._part.open(encoding='utf-8', errors='replace') as file:
            has_rows = not _HEADER.startswith(file.read(len(_HEADER) + 1))
        if has_rows:
            self.kept = _free_name(path)
            os.rename(self._part, self.kept)
            self._file.close()
            self._file = self._opened('x')
        self._file.truncate(0)
        self._table = csv.DictWriter(self._file, COLUMNS, lineterminator='\n')
        self._file.write(_HEADER)
        self._written, self._end = Event(), Event()
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

    def write(self, match: Match, duration_ms: float) -> None:
        """Append a row; OSError, naming the part file, if the disk is full."""
        with self._named():
            self._table.writerow(row(match, duration_ms))
        self._written.set()

    def close(self) -> None:
        """Give the table its name; OSError, naming the part file, if the disk is full."""
        if not self._file.closed:
            try:
                with self._named():
                    self._file.flush()
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
        self._end.set()
        self._written.set()
        with suppress(OSError):
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, _error: object, _trace: object) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()


def _sync(handle: int, written: Event, end: Event) -> None:
    """Sync new rows to the disk, at most once a second, also if no row follows."""
    while written.wait() and not end.is_set():
        written.clear()
        with suppress(OSError):
            os.fsync(handle)
        end.wait(_SYNC_EVERY_S)
    os.close(handle)


def _free_name(path: Path) -> Path:
    names = (path.with_name(f'{path.name}.{number}.part') for number in count(1))
    return next(name for name in names if not name.exists())


def read_results(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table, empty fields as empty texts; SourceError if it is no table."""
    refuse_irregular(path)
    try:
        with path.open(newline='', encoding='utf-8') as file:
            return list(csv.DictReader(file))
    except (csv.Error, UnicodeDecodeError) as error:
        raise SourceError(f'{path}: not a result table ({error}); write it again') from None
