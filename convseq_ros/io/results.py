# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result table, with a row for every frame."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
import csv
from itertools import count
from pathlib import Path
from typing import Self

from convseq_ros.errors import SourceError
from convseq_ros.io.regular_file import refuse_irregular, target_of


class ResultWriter:
    """
    Writes a result table row by row; use it as a context manager.

    `columns` are their names, such as those of `convseq_ros.app.result_row`. Each row is in the
    file once it is written, so a run that ends early leaves its rows. With `keeps_earlier` a table
    `a.csv` of before becomes `a.1.csv`, or has a higher number. OSError, which names the file, if
    it cannot be written.
    """

    def __init__(self, path: Path, columns: Sequence[str], keeps_earlier: bool = False) -> None:
        self._path = target_of(path)
        if keeps_earlier and self._path.exists():
            self._path.rename(_free_name(self._path))
        self._file = self._path.open('w', newline='', encoding='utf-8', buffering=1)
        self._table = csv.DictWriter(self._file, columns, lineterminator='\n')
        with self._named():
            self._table.writeheader()

    def write(self, row: Mapping[str, object]) -> None:
        """Append a row, by column; OSError if the disk is full."""
        with self._named():
            self._table.writerow(row)

    def close(self) -> None:
        with self._named():
            self._file.close()

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            error.filename = str(self._path)
            with suppress(OSError):  # what is left of the row cannot be written, either
                self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()


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
