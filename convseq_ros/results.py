# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result table: one row for every frame read, in order, for the node and the commands."""

from contextlib import suppress
import csv
import os
from pathlib import Path
from typing import Self

from convseq_ros.core.types import Match

COLUMNS = (
    'query_index', 'query_stamp_ns', 'status', 'reason', 'reference_index', 'reference_stamp_ns',
    'score', 'confidence', 'sequence_length', 'best_index', 'best_score', 'shift_rows',
    'shift_cols', 'pairs_scored', 'duration_ms', 'shift_rows_px', 'shift_cols_px',
    'relative_yaw_rad', 'inliers',
)  # fmt: skip


def row(match: Match, duration_ms: float) -> dict[str, object]:
    """Return the row of a match; None, an empty field, where there is nothing to say."""
    accepted, best = match.accepted, match.best
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
    }


def _decimals(value: float | None, count: int) -> str | None:
    return None if value is None else f'{value:.{count}f}'


class ResultWriter:
    """
    Writes a result table row by row; use it as a context manager.

    Rows stream to `<path>.part`, which takes its name when the work is done: a table under its own
    name is complete, and after an error or a crash the rows so far are in the part file.

    Parameters
    ----------
    path : Path
        The table; an existing one is replaced at the end.

    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._part = path.with_name(path.name + '.part')
        self._file = self._part.open('w', newline='', encoding='utf-8', buffering=1)
        self._table = csv.DictWriter(self._file, COLUMNS, lineterminator='\n')
        self._table.writeheader()

    def write(self, match: Match, duration_ms: float) -> None:
        """Append a row; OSError, naming the part file, if the disk is full."""
        try:
            self._table.writerow(row(match, duration_ms))
        except OSError as error:
            error.filename = str(self._part)
            raise

    def close(self) -> None:
        """Give the table its name."""
        if not self._file.closed:
            self._file.close()
            os.replace(self._part, self._path)

    def abandon(self) -> None:
        """Leave the rows so far in the part file."""
        with suppress(OSError):
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, _error: object, _trace: object) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()


def read_results(path: Path) -> list[dict[str, str]]:
    """Return the rows of a result table; empty fields are empty strings."""
    with path.open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))
